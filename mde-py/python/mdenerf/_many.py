"""Many photographs, one after the other."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _mdenerf as native
from ._arrays import PHOTOGRAPHS, Floats, ImageLike, PathLike, callers, in_folder
from ._mdenerf import Error
from ._result import RefinementWarning, Result

if TYPE_CHECKING:
    from ._refiner import Progress

#: Photographs that are prepared side by side.
_CHUNK = 4


@dataclass(frozen=True)
class SameScale:
    """The factor of a photograph's depth that brings it to one scale with others.

    Attributes
    ----------
    factor : float
        The factor of the model's prediction; the geometric mean over a group is 1. In ``Result.run["same_scale"]``, that of the refined map.
    log_sigma : float
        Standard deviation of its logarithm, relative to the mean over the group.
    group : int
        Photographs with the same number share a scale.
    photographs : int
        Number of photographs in the group; 1 for one that matches no other, and keeps its own scale.
    """

    factor: float
    log_sigma: float
    group: int
    photographs: int


def photographs_of(images: PathLike | Iterable[ImageLike]) -> list[ImageLike]:
    """The photographs of a folder in the order of their names, or those of an iterable."""
    if not isinstance(images, (str, os.PathLike)):
        return list(images)
    paths = in_folder("images", images)
    if not paths:
        raise Error(f"images {images}: the folder holds no photograph ({', '.join(PHOTOGRAPHS)}); folders within it are not searched")
    return list(paths)


def scales_of(
    scale: native.OneScale,
    images: list[ImageLike],
    prepared: Callable[[ImageLike], dict[str, Any]],
    how: tuple[native.Prior, native.Settings, Callable[[Floats], Floats] | None, int | None],
    progress: Progress | None,
) -> list[SameScale]:
    """The factor of each photograph; ``prepared`` gives the arguments of one."""
    prior, settings, model, threads = how
    errors: list[Error] = []

    def readable(image: ImageLike) -> dict[str, Any] | None:
        # The error of one is raised when it is refined.
        try:
            return prepared(image)
        except Error as error:
            errors.append(error)
            return None

    for first in range(0, len(images), _CHUNK):
        part = images[first : first + _CHUNK]
        scale.add(prior, settings, [readable(image) for image in part], model, threads)
        if progress is not None:
            progress("match", first + len(part), len(images))
    if images and len(errors) == len(images):
        raise errors[0]
    factors, warning = scale.factors()
    if warning is not None:
        warnings.warn(warning, RefinementWarning, stacklevel=callers())
    return [SameScale(*factor) for factor in factors]


def refine_each(
    images: Iterable[ImageLike],
    scales: Callable[[list[ImageLike]], list[SameScale]] | None,
    one: Callable[[ImageLike, SameScale | None], Result],
    return_exceptions: bool,
    progress: Progress | None,
) -> Iterator[Result | Error]:
    """The results, each computed at its step."""
    factors: list[SameScale] | None = None
    if scales is not None:
        images = list(images)
        try:
            factors = scales(images)
        except Error:
            # Each photograph then has its own.
            if not return_exceptions:
                raise
    total = len(images) if isinstance(images, Sized) else 0
    for index, image in enumerate(images):
        result: Result | Error
        try:
            result = one(image, None if factors is None else factors[index])
        except Error as error:
            if not return_exceptions:
                raise
            result = error
        if progress is not None:
            progress("photograph", index + 1, total)
        yield result
