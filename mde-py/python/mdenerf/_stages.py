"""The stages alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import Doubles, Floats, IntrinsicsLike, Mask, _unit, camera, depth_map, same_map
from ._inputs import Config, native_settings
from ._mdenerf import Error


@dataclass(eq=False)
class Fused:
    """The result of :func:`fuse`; every map is ``float32 [height, width]`` in the prior's unit.

    Attributes
    ----------
    depth, sigma : ndarray
        Refined depth and its standard deviation (Eq. 16-17).
    aggregated_depth, aggregated_sigma : ndarray
        The views together (Eq. 7-8), in their own scale and shift.
    aligned_depth, aligned_sigma : ndarray
        The same in the scale and shift of the prior (Eq. 10).
    report : dict
        ``a``, ``b``, ``sigma_o``, ``support``, ``warnings`` and the other estimates.
    """

    depth: Floats
    sigma: Floats
    aggregated_depth: Floats
    aggregated_sigma: Floats
    aligned_depth: Floats
    aligned_sigma: Floats
    report: dict[str, Any]


def fuse(
    prior: ArrayLike,
    views: Sequence[tuple[ArrayLike, ArrayLike]],
    *,
    prior_sigma: ArrayLike | None = None,
    preset: str = "paper",
    config: Config | None = None,
) -> Fused:
    """Fuses a prior depth with the depth of views that were reprojected into its camera (Eq. 7-17).

    Parameters
    ----------
    prior : ndarray
        ``[height, width]``; 0 where missing.
    views : sequence of (ndarray, ndarray)
        Depth and sigma of each view, ``[height, width]`` each, in about the prior's unit; sigma is infinite where missing.
    prior_sigma : ndarray or float, optional
        The prior's standard deviation; without it, it is estimated from the views (Eq. 15).
    preset, config
        Their ``fusion`` counts; ``paper`` is the equations as printed. See :class:`Refiner`.

    Returns
    -------
    Fused
    """
    depth = depth_map(prior, "prior")
    maps = [
        (same_map(view, depth.shape, f"views[{index}]"), same_map(sigma, depth.shape, f"sigma of views[{index}]"))
        for index, (view, sigma) in enumerate(views)
    ]
    known = None if prior_sigma is None else same_map(prior_sigma, depth.shape, "prior_sigma")
    settings = native_settings(preset, config)
    parts = native.fuse(depth, known, [view for view, _ in maps], [sigma for _, sigma in maps], settings)
    parts["report"] = json.loads(parts["report"])
    return Fused(**parts)


@dataclass(frozen=True)
class AffineFit:
    """The line of :func:`affine_wls`.

    Attributes
    ----------
    a, b : float
        Scale and shift.
    effective_support : float
        Effective number of samples: 1 where one has all the weight, their number where all weigh the same.
    correlation : float
        Weighted correlation of u and v; 0 where either is constant.
    relative_spread : float
        Weighted variance of u over its weighted mean square: 0 where u is constant and the slope unknown.
    """

    a: float
    b: float
    effective_support: float
    correlation: float
    relative_spread: float


def affine_wls(u: ArrayLike, v: ArrayLike, sigma: ArrayLike | None = None) -> AffineFit:
    """The line ``a u + b`` that fits ``v`` best, samples weighted by ``1 / sigma**2`` (Eq. 11-13).

    Parameters
    ----------
    u, v : ndarray
        Of one shape. Samples that are not finite, or whose sigma is infinite, are left out.
    sigma : ndarray or float, optional
        Standard deviation of u, 0 or more; without it all samples weigh the same.

    Returns
    -------
    AffineFit

    Raises
    ------
    Error
        Where the line is not determined: fewer than two samples, or all weight on one value of u.
    """
    x, y = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    s = np.ones_like(x) if sigma is None else np.asarray(sigma, dtype=np.float64)
    if s.ndim == 0:
        s = np.full_like(x, s)
    if not x.shape == y.shape == s.shape:
        raise Error(
            f"u has the shape {list(x.shape)}, v {list(y.shape)} and sigma {list(s.shape)}; give all of them one shape"
        )
    if not (np.isnan(s) | (s >= 0)).all():
        raise Error("sigma holds a negative number; give 0 or more")
    used = np.isfinite(x) & np.isfinite(y) & np.isfinite(s)
    fit = native.affine_wls(x[used], y[used], s[used] ** 2)
    if fit is None:
        raise Error("the line is not determined; give two samples or more of different u")
    return AffineFit(*fit)


@dataclass(eq=False)
class Moments:
    """The result of :func:`termination_moments`.

    Attributes
    ----------
    opacity : ndarray
        Probability that the ray ends, ``float64 [...]``.
    mean, sigma : ndarray
        Mean and standard deviation of where it ends, given that it does; 0 where the opacity is 0.
    weights : ndarray
        Termination weights of the bins, ``float64 [..., bins]``.
    """

    opacity: Doubles
    mean: Doubles
    sigma: Doubles
    weights: Doubles


def termination_moments(density: ArrayLike, edges: ArrayLike, *, uniform: bool = False) -> Moments:
    """Where rays end: opacity, mean and standard deviation from the densities along them (Eq. 2-5).

    Parameters
    ----------
    density : ndarray
        Density of each bin, ``[..., bins]``, 0 or more, per unit of length.
    edges : ndarray
        Ends of the bins along the ray, ``[bins + 1]`` or ``[..., bins + 1]``, increasing.
    uniform : bool
        Whether a ray ends anywhere within its bin with equal probability; by default at its middle, as printed.

    Returns
    -------
    Moments
    """
    densities, ends = np.asarray(density, dtype=np.float64), np.asarray(edges, dtype=np.float64)
    if densities.ndim == 0 or ends.ndim == 0 or ends.shape[-1] != densities.shape[-1] + 1:
        raise Error(
            f"density has the shape {list(densities.shape)} and edges {list(ends.shape)}; give [..., bins] and [..., bins + 1]"
        )
    if not (densities >= 0).all() or not (np.diff(ends) >= 0).all():
        raise Error("give densities of 0 or more, and edges that increase")
    rays = densities.shape[:-1]
    try:
        middle = np.broadcast_to(0.5 * (ends[..., 1:] + ends[..., :-1]), densities.shape)
        extent = np.broadcast_to(np.diff(ends), densities.shape)
    except ValueError:
        raise Error(f"edges has the shape {list(ends.shape)}, which does not fit density {list(densities.shape)}") from None

    def flat(part: Doubles) -> Doubles:
        return np.ascontiguousarray(part).reshape(-1, densities.shape[-1])

    (opacity, mean, variance), weights = native.termination_moments(
        flat(densities), flat(middle), flat(extent), uniform
    )
    return Moments(
        opacity.reshape(rays), mean.reshape(rays), np.sqrt(variance).reshape(rays), weights.reshape(densities.shape)
    )


@dataclass(eq=False)
class Warped:
    """The result of :func:`forward_warp`.

    Attributes
    ----------
    image : ndarray
        Colours, ``float32 [height, width, 3]`` in 0 to 1.
    depth, sigma : ndarray
        Depth in the target camera and its standard deviation, ``float32 [height, width]``; 0 and infinite where empty.
    mask : ndarray
        Where something landed, ``bool [height, width]``.
    hole_fraction, outside_fraction : float
        Shares of the pixels that are empty: uncovered behind an edge, and outside of the source's frame.
    """

    image: Floats
    depth: Floats
    sigma: Floats
    mask: Mask
    hole_fraction: float
    outside_fraction: float


def forward_warp(
    image: ArrayLike,
    depth: ArrayLike,
    intrinsics: IntrinsicsLike,
    pose: ArrayLike,
    *,
    sigma: ArrayLike = 0.0,
    target: tuple[IntrinsicsLike, tuple[int, int]] | None = None,
    tear: float = 0.05,
) -> Warped:
    """An image with its depth, seen from another pose (Eq. 1), with a z-buffer; surfaces are torn at depth edges.

    Parameters
    ----------
    image : ndarray
        ``[height, width, 3]``, as for :func:`refine`.
    depth : ndarray
        ``[height, width]``; 0 where missing.
    intrinsics : ndarray, dict or path
        The camera of the image; see :meth:`Refiner.refine`.
    pose : ndarray
        From the camera of the image to the other, ``[4, 4]``, in the unit of the depth.
    sigma : ndarray or float
        Standard deviation of the depth.
    target : (intrinsics, (height, width)), optional
        The other camera; by default the same.
    tear : float
        Relative difference of 1/depth above which neighbours belong to two surfaces, 0 to 1.

    Returns
    -------
    Warped
    """
    colours, z = np.asarray(image), depth_map(depth, "depth")
    if colours.shape != (*z.shape, 3):
        raise Error(f"the image has the shape {list(colours.shape)} but the depth {list(z.shape)}; give [height, width, 3]")
    motion = np.asarray(pose, dtype=np.float64)
    if motion.shape != (4, 4):
        raise Error(f"pose has the shape {list(motion.shape)}; give [4, 4]")
    other = None
    if target is not None:
        given, (height, width) = target
        other = (camera(given, None), (height, width))
    parts = native.forward_warp(
        _unit(colours, "image"),
        z,
        same_map(sigma, z.shape, "sigma"),
        (camera(intrinsics, None), motion.tolist()),
        other,
        tear,
    )
    return Warped(**parts)
