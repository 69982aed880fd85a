"""Monocular depth, refined, with a standard deviation per pixel.

>>> import mdenerf
>>> result = mdenerf.refine("photo.jpg", "network.onnx")        # doctest: +SKIP
>>> result.depth, result.sigma                                  # doctest: +SKIP

:func:`refine` refines the depth of one photograph, or of one of several of the same scene; a :class:`Refiner` keeps the network
loaded. :func:`dense` refines every photograph of a scene with the others, :func:`refine_many` many photographs each alone, if wanted
on one scale. The model is an ONNX file or any callable, such as a network in PyTorch; several photographs of one place need none.
:func:`fuse`, :func:`affine_wls`, :func:`termination_moments` and :func:`forward_warp` are stages alone, :mod:`mdenerf.metrics` scores
maps.

Depth is z along the optical axis, never the distance along the ray, as ``float32 [height, width]``. A pixel without depth has
depth 0 and an infinite sigma. Pixel centres are at integers, from 0. Cameras look along z; x is right, y is down.
"""

from . import metrics
from ._many import SameScale
from ._mdenerf import Error
from ._program import program
from ._refine import dense, refine, refine_many
from ._refiner import Refiner
from ._result import Camera, RefinementWarning, Result
from ._scene import Scene
from ._stages import (
    AffineFit,
    Fused,
    Moments,
    Warped,
    affine_wls,
    forward_warp,
    fuse,
    termination_moments,
)

__version__ = "0.1.0"

__all__ = [
    "AffineFit",
    "Camera",
    "Error",
    "Fused",
    "Moments",
    "RefinementWarning",
    "Refiner",
    "Result",
    "SameScale",
    "Scene",
    "Warped",
    "affine_wls",
    "dense",
    "forward_warp",
    "fuse",
    "metrics",
    "program",
    "refine",
    "refine_many",
    "termination_moments",
]
