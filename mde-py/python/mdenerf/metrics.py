"""Metrics of depth maps and of their standard deviations.

Maps are ``[height, width]``, z in metres where a threshold is in metres, and aligned already (:func:`align`). ``mask`` selects pixels;
without it those count where prediction and truth are positive and finite. Metrics of sigma take the errors, prediction minus truth, and
the standard deviations in one shape. :func:`score` gives most of them at once, by the protocol of ``mde eval``. The functions' equations
and sources are in the documentation of the crate ``mde-eval``.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import Doubles, Floats, Mask, depth_map
from ._mdenerf import Error

__all__ = [
    "EdgeScore",
    "Sparsification",
    "abs_rel",
    "align",
    "boundary_errors",
    "boundary_f1",
    "boundary_matches",
    "costs_by_sigma",
    "coverage",
    "crps",
    "delta",
    "edge_curve",
    "edge_f1",
    "edges",
    "ence",
    "irmse",
    "log10",
    "mace",
    "mean_z2",
    "miscalibration_area",
    "mse",
    "nll",
    "occlusion_f1",
    "ordinal_error",
    "reliability",
    "rms_sigma",
    "rmsce",
    "rmse",
    "rmse_log",
    "score",
    "sharpness",
    "sharpness_by_edges",
    "silog",
    "soft_edge_error",
    "sparsification",
    "spearman",
    "sq_rel",
    "superpixel_order",
]


class EdgeScore(NamedTuple):
    """Precision, recall and F1 of edges, 0 to 1."""

    precision: float
    recall: float
    f1: float


class Sparsification(NamedTuple):
    """Area between the curves of sigma and of the oracle (AUSE), area below the cost of all (AURG), and the curves ``float64 [n]``."""

    ause: float
    aurg: float
    removed: Doubles
    by_sigma: Doubles
    oracle: Doubles


def _pair(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None) -> tuple[Doubles, Doubles]:
    p, g = np.asarray(prediction, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    if p.shape != g.shape:
        raise Error(f"the prediction has the shape {list(p.shape)} but the truth {list(g.shape)}; give both one shape")
    keep = np.isfinite(p) & np.isfinite(g) & (p > 0) & (g > 0) if mask is None else _selected(mask, p.shape)
    return p[keep], g[keep]


def _selected(mask: ArrayLike, shape: tuple[int, ...]) -> Mask:
    selected = np.asarray(mask)
    if selected.dtype != np.bool_ or selected.shape != shape:
        raise Error(f"the mask is of {selected.dtype} {list(selected.shape)}; give bool {list(shape)}")
    return np.ascontiguousarray(selected)


def _maps(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None) -> tuple[Floats, Floats, Mask]:
    p, g = depth_map(prediction, "prediction"), depth_map(truth, "truth")
    if p.shape != g.shape:
        raise Error(f"the prediction has the shape {list(p.shape)} but the truth {list(g.shape)}; give both one shape")
    keep = np.isfinite(p) & np.isfinite(g) & (p > 0) & (g > 0) if mask is None else _selected(mask, p.shape)
    return p, g, keep


def _errors(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None) -> tuple[Doubles, Doubles]:
    e, s = np.asarray(error, dtype=np.float64), np.asarray(sigma, dtype=np.float64)
    if e.shape != s.shape:
        raise Error(f"the error has the shape {list(e.shape)} but sigma {list(s.shape)}; give both one shape")
    keep = np.isfinite(e) & np.isfinite(s) & (s > 0) if mask is None else _selected(mask, e.shape)
    return e[keep], s[keep]


def mse(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean squared error, in the unit of the depth squared."""
    return native.depth_metric("mse", *_pair(prediction, truth, mask))


def rmse(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Root of the mean squared error, in the unit of the depth."""
    return native.depth_metric("rmse", *_pair(prediction, truth, mask))


def abs_rel(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean of |p - g| / g."""
    return native.depth_metric("abs_rel", *_pair(prediction, truth, mask))


def sq_rel(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean of (p - g)^2 / g, in the unit of the depth."""
    return native.depth_metric("sq_rel", *_pair(prediction, truth, mask))


def rmse_log(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Root of the mean of (ln p - ln g)^2."""
    return native.depth_metric("rmse_log", *_pair(prediction, truth, mask))


def log10(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean of |log10 p - log10 g|."""
    return native.depth_metric("log10", *_pair(prediction, truth, mask))


def silog(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Scale-invariant logarithmic error: 100 times the standard deviation of ln p - ln g."""
    return native.depth_metric("silog", *_pair(prediction, truth, mask))


def irmse(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Root of the mean of (1/p - 1/g)^2, in one over the unit of the depth."""
    return native.depth_metric("irmse", *_pair(prediction, truth, mask))


def delta(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, *, k: int = 1) -> float:
    """Share of the pixels within a factor of 1.25^k."""
    return native.delta(*_pair(prediction, truth, mask), k)


def nll(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean negative logarithm of the normal likelihood."""
    return native.sigma_metric("nll", *_errors(error, sigma, mask))


def crps(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean continuous ranked probability score of the normal distribution, in the unit of the depth."""
    return native.sigma_metric("crps", *_errors(error, sigma, mask))


def mean_z2(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean of (error / sigma)^2: above 1 where sigma is too small."""
    return native.sigma_metric("mean_z2", *_errors(error, sigma, mask))


def rms_sigma(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Root of the mean of sigma squared, in the unit of the depth."""
    return native.sigma_metric("rms_sigma", *_errors(error, sigma, mask))


def mace(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean difference of nominal and observed coverage over all levels."""
    return native.sigma_metric("mace", *_errors(error, sigma, mask))


def rmsce(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Root of the mean squared distance of observed from nominal coverage."""
    return native.calibration_errors(*_errors(error, sigma, mask))[1]


def miscalibration_area(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Area between the curve of observed over nominal coverage and the diagonal."""
    return native.calibration_errors(*_errors(error, sigma, mask))[2]


def coverage(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, level: float = 0.9) -> float:
    """Share of the errors within the central normal interval of that probability."""
    return native.coverage(*_errors(error, sigma, mask), level)


def ence(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, bins: int = 20) -> float:
    """Expected normalised calibration error, in bins of equal numbers by sigma."""
    return native.ence(*_errors(error, sigma, mask), bins)


def reliability(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> Doubles:
    """Nominal and observed coverage, ``float64 [levels, 2]``."""
    return np.array(native.reliability(*_errors(error, sigma, mask)))


def costs_by_sigma(
    cost: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, bins: int = 100
) -> tuple[Doubles, float | None]:
    """Costs by percentile of sigma.

    Parameters
    ----------
    cost, sigma : ndarray
        Costs of the pixels, such as the absolute error, and their standard deviations, in one shape.
    mask : ndarray, optional
        Pixels that may count, ``bool`` in the same shape; by default those where both are finite and sigma is positive.
    bins : int
        Number of runs of equal size in order of sigma.

    Returns
    -------
    (ndarray, float or None)
        ``float64 [bins, 2]``, mean sigma and mean cost of each bin; and Spearman's correlation of the two, None where either is constant.
    """
    table, correlation = native.costs_by_sigma(*_errors(cost, sigma, mask), bins)
    return np.array(table, dtype=np.float64).reshape(-1, 2), correlation


def spearman(x: ArrayLike, y: ArrayLike) -> float | None:
    """Spearman's correlation of two lists, ties averaged; None where one is constant."""
    return native.spearman(np.asarray(x, dtype=np.float64).ravel(), np.asarray(y, dtype=np.float64).ravel())


def sparsification(
    cost: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, root: bool = False, definition: str = "goli"
) -> Sparsification:
    """How the mean cost falls where the least certain pixels are removed.

    Parameters
    ----------
    cost, sigma : ndarray
        Cost of each pixel, such as its absolute or squared error, and its standard deviation.
    root : bool
        Whether the root of the mean counts, for squared errors.
    definition : {"goli", "poggi"}
        Goli et al. (CVPR 2024), without a unit; or Poggi et al. (CVPR 2020), in the unit of the cost.
    """
    if definition not in ("goli", "poggi"):
        raise Error(f"definition is {definition!r}; give goli or poggi")
    ause, aurg, *curves = native.sparsification_curves(*_errors(cost, sigma, mask), root, definition == "poggi")
    removed, by_sigma, oracle = (np.array(curve) for curve in curves)
    return Sparsification(ause, aurg, removed, by_sigma, oracle)


def sharpness(map: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean gradient of a map over its median, per pixel; blind to scale."""
    values = depth_map(map, "map")
    keep = np.isfinite(values) & (values > 0) if mask is None else _selected(mask, values.shape)
    return native.mean_gradient(values, keep)


def sharpness_by_edges(
    map: ArrayLike, edges: ArrayLike, mask: ArrayLike | None = None, *, band: float = 3.0
) -> tuple[float | None, float | None]:
    """:func:`sharpness` within ``band`` pixels of edges, those of the truth, ``bool [height, width]``, and beyond; None where there is no pixel."""
    values = depth_map(map, "map")
    keep = np.isfinite(values) & (values > 0) if mask is None else _selected(mask, values.shape)
    return native.mean_gradient_by_edges(values, keep, _selected(edges, values.shape), band)


def edges(map: ArrayLike, mask: ArrayLike | None = None, *, threshold: float = 0.25) -> Mask:
    """Where Sobel's gradient (gain 8) exceeds the threshold, in the unit of the map."""
    values = depth_map(map, "map")
    keep = np.isfinite(values) & (values > 0) if mask is None else _selected(mask, values.shape)
    return native.edge_map(values, keep, threshold)


def edge_f1(
    prediction: ArrayLike,
    truth: ArrayLike,
    mask: ArrayLike | None = None,
    *,
    threshold: float = 0.25,
    tolerance: int = 1,
) -> EdgeScore:
    """Edges found, at one threshold of both maps in their unit, within a tolerance in pixels."""
    return EdgeScore(*native.edge_f1(*_maps(prediction, truth, mask), threshold, tolerance))


def edge_curve(
    prediction: ArrayLike,
    truth: ArrayLike,
    mask: ArrayLike | None = None,
    *,
    threshold: float = 0.25,
    tolerance: int = 1,
) -> tuple[float, float] | None:
    """Largest F1 and average precision over all thresholds of the prediction; None where the truth has no edge."""
    return native.edge_curve(*_maps(prediction, truth, mask), threshold, tolerance)


def boundary_matches(
    prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, *, threshold: float = 0.25
) -> tuple[float, float] | None:
    """Best F1 and average precision of thinned edges that are matched one to one; None where the truth has no edge."""
    return native.boundary_matches(*_maps(prediction, truth, mask), threshold)


def boundary_f1(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Scale-invariant boundary F1 of Depth Pro."""
    return native.boundary_f1(*_maps(prediction, truth, mask))


def occlusion_f1(prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None) -> tuple[float, float, float]:
    """Occlusion-boundary F1 of MoGe at radii of 1, 2 and 3 pixels."""
    first, second, third = native.occlusion_f1(*_maps(prediction, truth, mask))
    return first, second, third


def boundary_errors(
    prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None
) -> tuple[float, float] | None:
    """Accuracy and completeness of depth boundaries, pixels (iBims-1); None where the truth has no boundary."""
    return native.boundary_errors(*_maps(prediction, truth, mask))


def soft_edge_error(
    prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, *, threshold: float = 0.25
) -> float | None:
    """Soft edge error at the true edges above that threshold; None where there is none."""
    p, g, keep = _maps(prediction, truth, mask)
    return native.soft_edge_error(p, g, keep, native.edge_map(g, keep, threshold))


def ordinal_error(
    prediction: ArrayLike,
    truth: ArrayLike,
    mask: ArrayLike | None = None,
    *,
    count: int = 400_000,
    radius: int | None = 12,
    min_ratio: float = 1.1,
    tie_ratio: float = 1.01,
    seed: int = 0,
) -> float | None:
    """Share of random pairs in wrong order; by default of neighbours across discontinuities (D3R-like). None without a pair."""
    return native.ordinal_error(*_maps(prediction, truth, mask), (count, radius, min_ratio, tie_ratio, seed))


def superpixel_order(
    prediction: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None
) -> tuple[float | None, float | None]:
    """Wrong order of superpixels: D3R of neighbours across discontinuities, and ORD of any two; None without a pair."""
    return native.superpixel_order(*_maps(prediction, truth, mask))


def align(
    prediction: ArrayLike, truth: ArrayLike, rule: str = "median", mask: ArrayLike | None = None
) -> tuple[Floats, dict[str, Any]]:
    """A prediction in the scale of the truth.

    Parameters
    ----------
    prediction, truth : ndarray
        ``[height, width]``; 0 where missing.
    rule : {"none", "median", "median-ratio", "least-squares-depth", "least-squares-disparity"}
        What is fitted.
    mask : ndarray, optional
        Pixels that may count, ``bool [height, width]``.

    Returns
    -------
    (ndarray, dict)
        The aligned map, and the fit.
    """
    p, g = depth_map(prediction, "prediction"), depth_map(truth, "truth")
    keep = None if mask is None else _selected(mask, p.shape)
    aligned, fit = native.align(p, g, rule, keep)
    return aligned, json.loads(fit)


def score(
    prediction: ArrayLike,
    truth: ArrayLike,
    sigma: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Aligns a prediction and scores it by the protocol of ``mde eval``.

    Parameters
    ----------
    prediction, truth, sigma : ndarray
        ``[height, width]``, the truth in metres; sigma in the unit of the prediction. 0 where missing.
    mask : ndarray, optional
        Pixels that may count, ``bool [height, width]``.
    **settings
        ``alignment`` (see :func:`align`), ``min_depth``, ``max_depth``, ``crop``, ``edge_thresholds`` and the other fields of
        ``mde_eval::score::ScoreConfig``.

    Returns
    -------
    dict
        ``alignment``, ``pixels``, ``depth`` and ``uncertainty`` with their scores by name.
    """
    p, g = depth_map(prediction, "prediction"), depth_map(truth, "truth")
    s = None if sigma is None else depth_map(sigma, "sigma")
    keep = None if mask is None else _selected(mask, p.shape)
    config = json.dumps({name.replace("_", "-"): value for name, value in settings.items()})
    scores: dict[str, Any] = json.loads(native.score_maps(p, g, s, keep, config))
    return scores
