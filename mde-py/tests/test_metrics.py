"""The metrics against their equations in NumPy."""

import numpy as np
import pytest

import mdenerf
from mdenerf import metrics

RNG = np.random.default_rng(11)
TRUTH = np.where(np.arange(64) < 32, 1.5, 3.0 + 0.01 * np.arange(64)) + np.zeros((48, 1))
PREDICTION = TRUTH * np.exp(RNG.normal(0, 0.1, TRUTH.shape))
SIGMA = 0.1 * TRUTH
ERROR = PREDICTION - TRUTH


def test_errors_of_depth():
    p, g = PREDICTION, TRUTH
    log = np.log(p / g)
    expected = {
        "mse": np.mean((p - g) ** 2),
        "rmse": np.sqrt(np.mean((p - g) ** 2)),
        "abs_rel": np.mean(np.abs(p - g) / g),
        "sq_rel": np.mean((p - g) ** 2 / g),
        "rmse_log": np.sqrt(np.mean(log**2)),
        "log10": np.mean(np.abs(np.log10(p / g))),
        "silog": 100 * np.std(log),
        "irmse": np.sqrt(np.mean((1 / p - 1 / g) ** 2)),
        "delta": np.mean(np.maximum(p / g, g / p) < 1.25),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(metrics, name)(p, g), value, rtol=1e-9, err_msg=name)
    holes = p.copy()
    holes[3, 4] = 0
    mask = np.ones(p.shape, bool)
    mask[3, 4] = False
    assert metrics.mse(holes, g) == metrics.mse(p, g, mask)
    with pytest.raises(mdenerf.Error, match="one shape"):
        metrics.mse(p, g[1:])


def test_metrics_of_sigma():
    z = ERROR / SIGMA
    np.testing.assert_allclose(metrics.mean_z2(ERROR, SIGMA), np.mean(z**2))
    np.testing.assert_allclose(metrics.rms_sigma(ERROR, SIGMA), np.sqrt(np.mean(SIGMA**2)))
    np.testing.assert_allclose(metrics.nll(ERROR, SIGMA), np.mean(0.5 * z**2 + np.log(SIGMA) + 0.5 * np.log(2 * np.pi)))
    np.testing.assert_allclose(metrics.coverage(ERROR, SIGMA, level=0.9), np.mean(np.abs(z) <= 1.6448536269514722))
    assert 0.85 < metrics.coverage(ERROR, SIGMA) < 0.95
    assert metrics.mace(ERROR, SIGMA) < 0.03 < metrics.mace(ERROR, 3 * SIGMA)
    assert metrics.ence(ERROR, SIGMA) < metrics.ence(ERROR, 3 * SIGMA)
    curve = metrics.reliability(ERROR, SIGMA)
    misses = curve[:, 1] - curve[:, 0]
    np.testing.assert_allclose(metrics.rmsce(ERROR, SIGMA), np.sqrt(np.mean(misses**2)))
    fine = np.linspace(0, 1, 200_001)
    gap = np.abs(np.interp(fine, *curve.T) - fine)
    np.testing.assert_allclose(metrics.miscalibration_area(ERROR, SIGMA), np.mean((gap[1:] + gap[:-1]) / 2), rtol=1e-4)
    bins, correlation = metrics.costs_by_sigma(np.abs(ERROR), SIGMA, bins=2)
    halves = np.sort(SIGMA.ravel()).reshape(2, -1).mean(axis=1)
    np.testing.assert_allclose(bins[:, 0], halves)
    np.testing.assert_allclose(bins[:, 1].mean(), np.abs(ERROR).mean())
    assert correlation == (1 if bins[1, 1] > bins[0, 1] else -1)
    assert 0 < metrics.crps(ERROR, SIGMA) < metrics.crps(ERROR, 10 * SIGMA)
    table = metrics.reliability(ERROR, SIGMA)
    assert table.shape[1] == 2 and np.abs(table[:, 0] - table[:, 1]).max() < 0.05
    assert metrics.spearman(np.arange(9), np.arange(9) ** 3) == 1 and metrics.spearman([1, 1], [1, 2]) is None
    right = metrics.sparsification(np.abs(ERROR), np.abs(ERROR) + 1e-9)
    assert right.ause < 1e-9 < right.aurg and right.removed.shape == right.oracle.shape
    assert metrics.sparsification(np.abs(ERROR), SIGMA, definition="poggi").ause > 0


def test_metrics_of_edges_and_order():
    # A mean over four directions, of which the truth has one.
    assert metrics.boundary_f1(TRUTH, TRUTH) == 0.25 > metrics.boundary_f1(TRUTH[:, ::-1], TRUTH)
    assert metrics.ordinal_error(TRUTH, TRUTH) == 0
    assert metrics.ordinal_error(5 - TRUTH, TRUTH) > 0.9
    np.testing.assert_allclose(metrics.edge_f1(TRUTH, TRUTH), 1)
    assert metrics.edge_f1(np.full(TRUTH.shape, 2.0), TRUTH).f1 == 0
    np.testing.assert_allclose(metrics.edge_curve(TRUTH, TRUTH), 1)
    assert metrics.edge_curve(TRUTH, np.full(TRUTH.shape, 2.0)) is None
    np.testing.assert_allclose(metrics.boundary_matches(TRUTH, TRUTH)[0], 1)
    np.testing.assert_allclose(metrics.occlusion_f1(TRUTH, TRUTH), 1)
    assert metrics.boundary_errors(TRUTH, TRUTH) == (0, 0)
    assert metrics.soft_edge_error(TRUTH, TRUTH) == 0 < metrics.soft_edge_error(PREDICTION, TRUTH)
    assert metrics.edges(TRUTH).any(axis=0).nonzero()[0].tolist() == [31, 32]
    assert metrics.sharpness(TRUTH) == metrics.sharpness(2 * TRUTH) > 0
    near, far = metrics.sharpness_by_edges(TRUTH, metrics.edges(TRUTH))
    assert near > metrics.sharpness(TRUTH) > far
    assert metrics.sharpness_by_edges(TRUTH, np.zeros(TRUTH.shape, bool)) == (None, metrics.sharpness(TRUTH))
    d3r, order = metrics.superpixel_order(TRUTH, TRUTH)
    assert order == 0 and d3r in (0, None)


def test_the_interpreter_is_free_meanwhile(ticker):
    truth = 2 + RNG.random((360, 480))
    prediction = truth * np.exp(RNG.normal(0, 0.1, truth.shape))
    assert ticker(lambda: metrics.boundary_matches(prediction, truth)) < 0.5


def test_alignment_and_all_scores():
    aligned, fit = metrics.align(0.5 * TRUTH, TRUTH)
    np.testing.assert_allclose(aligned, TRUTH, rtol=1e-6)
    assert fit
    inverse, _ = metrics.align(1 / (0.3 / TRUTH + 0.1), TRUTH, "least-squares-disparity")
    np.testing.assert_allclose(inverse, TRUTH, rtol=1e-4)
    scores = metrics.score(0.5 * PREDICTION, TRUTH, 0.5 * SIGMA, alignment="median", max_depth=8.0)
    assert scores["pixels"] == TRUTH.size and scores["rule"] == "median"
    np.testing.assert_allclose(scores["depth"]["abs-rel"], metrics.abs_rel(*metrics_pair()), rtol=1e-5)
    assert scores["uncertainty"]["coverage"]
    for settings, named in (({"alignment": "mean"}, "mean"), ({"max_depht": 3}, "max-depht")):
        with pytest.raises(mdenerf.Error, match=named):
            metrics.score(PREDICTION, TRUTH, **settings)


def metrics_pair():
    return metrics.align(0.5 * PREDICTION, TRUTH)[0], TRUTH
