"""The stages alone against their equations in NumPy."""

import numpy as np
import pytest

import mdenerf

RNG = np.random.default_rng(7)


def test_the_line_is_that_of_the_normal_equations():
    u, sigma = RNG.uniform(1, 5, 200), RNG.uniform(0.1, 1, 200)
    v = 0.7 * u + 0.3 + RNG.normal(0, 0.1, 200)
    fit = mdenerf.affine_wls(u, v, sigma)
    root = 1 / sigma
    (a, b), *_ = np.linalg.lstsq(np.stack([u * root, root], axis=1), v * root, rcond=None)
    np.testing.assert_allclose([fit.a, fit.b], [a, b], rtol=1e-10)
    p = sigma**-2.0
    np.testing.assert_allclose(fit.effective_support, p.sum() ** 2 / (p**2).sum())
    maps = u.reshape(10, 20), v.reshape(10, 20)
    again = mdenerf.affine_wls(*maps)
    np.testing.assert_allclose([again.a, again.b], np.polyfit(u, v, 1), rtol=1e-10)
    u[0] = np.nan
    assert np.isfinite(mdenerf.affine_wls(u, v).a)
    with pytest.raises(mdenerf.Error, match="not determined"):
        mdenerf.affine_wls([1.0, 1.0], [2.0, 3.0])
    with pytest.raises(mdenerf.Error, match="one shape"):
        mdenerf.affine_wls([1.0, 2.0], [2.0])


@pytest.mark.parametrize("uniform", [False, True])
def test_the_moments_of_a_termination(uniform):
    density, edges = RNG.uniform(0, 3, (4, 5, 30)), np.sort(RNG.uniform(0.5, 6, 31))
    found = mdenerf.termination_moments(density, edges, uniform=uniform)
    extent, middle = np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    alpha = 1 - np.exp(-density * extent)
    behind = np.cumprod(1 - alpha, axis=-1)
    weights = alpha * np.concatenate([np.ones((4, 5, 1)), behind[..., :-1]], axis=-1)
    share = weights / weights.sum(-1, keepdims=True)
    mean = (share * middle).sum(-1)
    variance = (share * ((middle - mean[..., None]) ** 2 + uniform * extent**2 / 12)).sum(-1)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-12)
    np.testing.assert_allclose(found.opacity, weights.sum(-1), rtol=1e-12)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-12)
    np.testing.assert_allclose(found.sigma, np.sqrt(variance), rtol=1e-10)
    nothing = mdenerf.termination_moments(np.zeros(30), edges)
    assert nothing.opacity == nothing.mean == nothing.sigma == 0 and nothing.weights.shape == (30,)
    with pytest.raises(mdenerf.Error, match="bins"):
        mdenerf.termination_moments(np.ones(3), np.ones(3))


def test_a_fusion_is_the_product_of_gaussians():
    """With a known sigma of the prior and views in its scale, Eq. 16 is the precision-weighted mean."""
    truth = RNG.uniform(2, 4, (20, 30))
    prior = np.float32(truth + RNG.normal(0, 0.2, truth.shape))
    views = [(np.float32(truth + RNG.normal(0, 0.1, truth.shape)), np.float32(0.1)) for _ in range(3)]
    fused = mdenerf.fuse(prior, views, prior_sigma=0.2)
    a, b = fused.report["a"], fused.report["b"]
    mean = np.mean([view for view, _ in views], axis=0, dtype=np.float64)
    np.testing.assert_allclose(fused.aggregated_depth, mean, rtol=1e-5)
    np.testing.assert_allclose(fused.aligned_depth, a * mean + b, rtol=1e-5)
    precision = 1 / fused.aligned_sigma.astype(np.float64) ** 2
    expected = (prior / 0.04 + fused.aligned_depth * precision) / (1 / 0.04 + precision)
    np.testing.assert_allclose(fused.depth, expected, rtol=1e-4)
    np.testing.assert_allclose(fused.sigma, (1 / 0.04 + precision) ** -0.5, rtol=1e-4)
    assert np.abs(fused.depth - truth).mean() < 0.6 * np.abs(prior - truth).mean()
    missing = mdenerf.fuse(prior, [(views[0][0], np.float32(np.inf))], prior_sigma=0.2)
    np.testing.assert_array_equal(missing.depth, prior)
    estimated = mdenerf.fuse(prior, views)
    assert abs(estimated.report["sigma_o"] - 0.2) < 0.05
    with pytest.raises(mdenerf.Error, match="one shape"):
        mdenerf.fuse(prior, [(np.ones((3, 3)), 0.1)])


def test_a_warp_moves_a_wall_by_its_disparity():
    image = RNG.uniform(0, 1, (24, 32, 3)).astype(np.float32)
    intrinsics = dict(fx=100, fy=100, cx=15.5, cy=11.5)
    pose = np.eye(4)
    pose[0, 3] = -0.04
    warped = mdenerf.forward_warp(image, np.full((24, 32), 2.0), intrinsics, pose, sigma=0.1)
    # 100 * 0.04 / 2 = 2 pixels.
    np.testing.assert_allclose(warped.image[:, :30], image[:, 2:], atol=1e-5)
    assert warped.mask[:, :30].all() and not warped.mask[:, 30:].any()
    assert warped.hole_fraction == 0 and warped.outside_fraction == 2 / 32
    np.testing.assert_allclose(warped.depth[warped.mask], 2.0)
    np.testing.assert_allclose(warped.sigma[warped.mask], 0.1, rtol=1e-6)
    assert np.isinf(warped.sigma[~warped.mask]).all()
    larger = mdenerf.forward_warp(image, np.full((24, 32), 2.0), intrinsics, pose, target=(intrinsics, (30, 40)))
    assert larger.depth.shape == (30, 40)
    with pytest.raises(mdenerf.Error, match="pose: no rigid motion"):
        mdenerf.forward_warp(image, np.full((24, 32), 2.0), intrinsics, 2 * np.eye(4))
