"""Scores of depth maps and of their standard deviations.

:func:`score` gives all metrics of ``mde eval`` at once, by its protocol; their equations and sources are in the documentation of the crate
``mde-eval``. Beside it are the alignment alone and four curves. Maps are ``[height, width]``; ``mask`` selects pixels, and without it those
count where all values are finite and depths and standard deviations are positive.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import Doubles, Floats, Mask, depth_map
from ._mdenerf import Error

__all__ = ["align", "costs_by_sigma", "edge_curve", "reliability", "score", "sparsification"]


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


def reliability(error: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None) -> Doubles:
    """Nominal and observed coverage of central intervals, ``float64 [levels, 2]``; ``error`` is prediction minus truth."""
    return native.reliability(*_errors(error, sigma, mask))


def costs_by_sigma(
    cost: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, bins: int = 100
) -> Doubles:
    """Mean sigma and mean cost, such as the absolute error, of ``bins`` runs of equal size by rising sigma, ``float64 [bins, 2]``."""
    return native.costs_by_sigma(*_errors(cost, sigma, mask), bins)


def sparsification(
    cost: ArrayLike, sigma: ArrayLike, mask: ArrayLike | None = None, *, root: bool = False
) -> Doubles:
    """How the mean cost falls where pixels are removed (Goli et al., CVPR 2024), ``float64 [100, 3]``.

    Columns are the share of the pixels removed, the cost of the rest where the least certain go first, and where the costliest do, both
    over their largest value. ``root`` takes the root of the mean, for squared errors.
    """
    return native.sparsification_curve(*_errors(cost, sigma, mask), root)


def edge_curve(
    prediction: ArrayLike,
    truth: ArrayLike,
    mask: ArrayLike | None = None,
    *,
    threshold: float = 0.25,
    tolerance: int = 1,
) -> Doubles | None:
    """Threshold, precision and recall of edges over all thresholds of the prediction, ``float64 [points, 3]``.

    True edges are where Sobel's gradient (gain 8) exceeds ``threshold``, in metres; edges match within ``tolerance`` pixels. None where the
    truth has no edge.
    """
    return native.edge_curve(*_maps(prediction, truth, mask), threshold, tolerance)


def align(
    prediction: ArrayLike, truth: ArrayLike, rule: str = "median-ratio", mask: ArrayLike | None = None
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
        ``alignment`` (see :func:`align`), ``min_depth``, ``max_depth`` and ``crop``, the fields of ``mde_eval::score::ScoreConfig``.

    Returns
    -------
    dict
        ``rule``, ``alignment``, ``pixels``, and every metric of ``scenes.csv`` by its name there, such as ``abs_rel`` or ``coverage_90``; one that
        is not defined for these maps is left out.
    """
    p, g = depth_map(prediction, "prediction"), depth_map(truth, "truth")
    s = None if sigma is None else depth_map(sigma, "sigma")
    keep = None if mask is None else _selected(mask, p.shape)
    config = json.dumps({name.replace("_", "-"): value for name, value in settings.items()})
    scores: dict[str, Any] = json.loads(native.score_maps(p, g, s, keep, config))
    return scores
