"""The scores and curves against their equations in NumPy."""

import numpy as np
import pytest

import mdenerf
from mdenerf import metrics

RNG = np.random.default_rng(11)
TRUTH = np.where(np.arange(64) < 32, 1.5, 3.0 + 0.01 * np.arange(64)) + np.zeros((48, 1))
PREDICTION = TRUTH * np.exp(RNG.normal(0, 0.1, TRUTH.shape))
SIGMA = 0.1 * TRUTH
ERROR = PREDICTION - TRUTH


def test_scores():
    scores = metrics.score(PREDICTION, TRUTH, SIGMA, alignment="none")
    p, g, z = PREDICTION, TRUTH, ERROR / SIGMA
    log = np.log(p / g)
    expected = {
        "mse": np.mean((p - g) ** 2),
        "rmse": np.sqrt(np.mean((p - g) ** 2)),
        "abs_rel": np.mean(np.abs(p - g) / g),
        "rmse_log": np.sqrt(np.mean(log**2)),
        "silog": 100 * np.std(log),
        "irmse": np.sqrt(np.mean((1 / p - 1 / g) ** 2)),
        "delta1": np.mean(np.maximum(p / g, g / p) < 1.25),
        "mean_z2": np.mean(z**2),
        "nll": np.mean(0.5 * z**2 + np.log(SIGMA) + 0.5 * np.log(2 * np.pi)),
        "coverage_90": np.mean(np.abs(z) <= 1.6448536269514722),
    }
    for name, value in expected.items():
        # Maps are kept in 32 bits.
        np.testing.assert_allclose(scores[name], value, rtol=1e-4, err_msg=name)
    assert scores["pixels"] == TRUTH.size and scores["rule"] == "none"
    holes = PREDICTION.copy()
    holes[3, 4] = 0
    mask = np.ones(p.shape, bool)
    mask[3, 4] = False
    assert metrics.score(holes, TRUTH) == metrics.score(PREDICTION, TRUTH, mask=mask)
    perfect = metrics.score(TRUTH, TRUTH)
    # A mean over four directions, of which the truth has one.
    assert perfect["boundary_f1"] == 0.25 and perfect["dbe_completeness"] == 0 and perfect["f1_max@0.25m_r1"] == 1
    assert "spearman" not in perfect
    assert "f1_max@0.25m_r1" not in metrics.score(TRUTH, np.full(TRUTH.shape, 2.0))


def test_alignment():
    aligned, fit = metrics.align(0.5 * TRUTH, TRUTH)
    np.testing.assert_allclose(aligned, TRUTH, rtol=1e-6)
    assert fit
    inverse, _ = metrics.align(1 / (0.3 / TRUTH + 0.1), TRUTH, "least-squares-disparity")
    np.testing.assert_allclose(inverse, TRUTH, rtol=1e-4)
    scores = metrics.score(0.5 * PREDICTION, TRUTH, 0.5 * SIGMA, max_depth=8.0)
    aligned, _ = metrics.align(0.5 * PREDICTION, TRUTH)
    np.testing.assert_allclose(scores["abs_rel"], np.mean(np.abs(aligned / TRUTH - 1)), rtol=1e-5)


def test_curves():
    curve = metrics.reliability(ERROR, SIGMA)
    assert curve.shape == (100, 2) and np.abs(curve[:, 0] - curve[:, 1]).max() < 0.05
    covered = metrics.score(PREDICTION, TRUTH, SIGMA, alignment="none")["coverage_90"]
    assert abs(np.interp(0.9, curve[:, 0], curve[:, 1]) - covered) < 0.01
    bins = metrics.costs_by_sigma(np.abs(ERROR), SIGMA, bins=2)
    np.testing.assert_allclose(bins[:, 0], np.sort(SIGMA.ravel()).reshape(2, -1).mean(axis=1))
    np.testing.assert_allclose(bins[:, 1].mean(), np.abs(ERROR).mean())
    removed, by_sigma, oracle = metrics.sparsification(np.abs(ERROR), np.abs(ERROR) + 1e-9).T
    assert removed[0] == 0 and by_sigma[0] == 1 and np.abs(by_sigma - oracle).max() < 1e-9
    threshold, precision, recall = metrics.edge_curve(TRUTH, TRUTH).T
    assert (np.diff(threshold) < 0).all() and recall[-1] == 1 and precision[0] == 1
    assert metrics.edge_curve(TRUTH, np.full(TRUTH.shape, 2.0)) is None


def test_the_interpreter_is_free_meanwhile(ticker):
    truth = 2 + RNG.random((360, 480))
    prediction = truth * np.exp(RNG.normal(0, 0.1, truth.shape))
    assert ticker(lambda: metrics.score(prediction, truth)) < 0.5


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: metrics.score(PREDICTION, TRUTH, alignment="mean"), "mean"),
        (lambda: metrics.score(PREDICTION, TRUTH, max_depht=3), "max-depht"),
        (lambda: metrics.score(PREDICTION, TRUTH[1:]), "48x64|64x48|47|48"),
        (lambda: metrics.reliability(ERROR, SIGMA[1:]), "one shape"),
        (lambda: metrics.edge_curve(TRUTH, TRUTH[1:]), "one shape"),
        (lambda: metrics.costs_by_sigma(np.abs(ERROR), SIGMA, SIGMA), "mask"),
    ],
)
def test_faults_are_named(call, named):
    with pytest.raises(mdenerf.Error, match=named):
        call()
