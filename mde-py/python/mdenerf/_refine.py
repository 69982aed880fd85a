"""The refinement of photographs, with a model for one call."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Literal, overload

from numpy.typing import ArrayLike

from ._arrays import ImageLike, IntrinsicsLike, Model, PathLike, Views
from ._inputs import Config
from ._mdenerf import Error
from ._refiner import Progress, Refiner
from ._result import Result
from ._scene import Scene


def refine(
    image: ImageLike,
    prior_model: Model | None = None,
    *,
    prior_depth: PathLike | ArrayLike | None = None,
    png_scale: float | None = None,
    prior_kind: str | None = None,
    model_profile: PathLike | None = None,
    preset: str | None = None,
    config: Config | None = None,
    intrinsics: IntrinsicsLike | None = None,
    fov: float | None = None,
    views: Views | None = None,
    poses: ArrayLike | None = None,
    unit: str = "prior",
    scale_from: PathLike | ArrayLike | None = None,
    keep_field: bool = False,
    interval: float | None = None,
    calibration: PathLike | None = None,
    seed: int | None = None,
    predictions: int | Literal["auto"] | None = None,
    no_nerf: bool = False,
    depth_range: tuple[float, float] | None = None,
    runtime: str = "auto",
    onnxruntime: PathLike | None = None,
    max_size: int | None = None,
    work_size: float = 1.5,
    max_memory: float = 8.0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Refines the depth of a photograph: a model's, or a depth map.

    The parameters are those of :class:`Refiner`, which keeps the model for several photographs, and of :meth:`Refiner.refine`. Give
    ``prior_model``, ``prior_depth`` or ``views``.

    Returns
    -------
    Result

    Raises
    ------
    Error
        For an input, a setting or a stage at fault, in one line that names it and the remedy.
    KeyboardInterrupt
        After Ctrl-C.

    Examples
    --------
    >>> mdenerf.refine("photo.jpg", "network.onnx")                              # doctest: +SKIP
    >>> mdenerf.refine("photo.jpg", prior_depth="depth.npy", fov=65)             # doctest: +SKIP
    >>> mdenerf.refine("photo.jpg", "network.onnx", interval=0.9).lower          # doctest: +SKIP
    >>> mdenerf.refine("a.jpg", "network.onnx", views=["b.jpg", "c.jpg"])        # doctest: +SKIP
    """
    refiner = Refiner(
        prior_model,
        prior_kind=prior_kind,
        model_profile=model_profile,
        preset=preset,
        config=config,
        seed=seed,
        predictions=predictions,
        no_nerf=no_nerf,
        depth_range=depth_range,
        runtime=runtime,
        onnxruntime=onnxruntime,
        max_size=max_size,
        work_size=work_size,
        max_memory=max_memory,
        interval=interval,
        calibration=calibration,
        threads=threads,
    )
    return refiner.refine(
        image,
        prior_depth=prior_depth,
        png_scale=png_scale,
        intrinsics=intrinsics,
        fov=fov,
        views=views,
        poses=poses,
        unit=unit,
        scale_from=scale_from,
        keep_field=keep_field,
        progress=progress,
    )


def dense(
    capture: Views,
    prior_model: Model | None = None,
    *,
    intrinsics: IntrinsicsLike | None = None,
    fov: float | None = None,
    poses: ArrayLike | None = None,
    unit: str = "prior",
    keep_field: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> Scene:
    """Refines the depth of every photograph of a static scene, with the depth that the others carry.

    The parameters are those of :class:`Refiner` (``settings``) and of :meth:`Refiner.dense`.

    Returns
    -------
    Scene
        A sequence of results in the order of the photographs, with the poses.

    Raises
    ------
    Error
        For an input, a setting or a stage at fault, in one line that names it and the remedy.
    KeyboardInterrupt
        After Ctrl-C.

    Examples
    --------
    >>> scene = mdenerf.dense("photos")                     # doctest: +SKIP
    >>> scene.save("out/room")                              # doctest: +SKIP
    """
    return Refiner(prior_model, **settings).dense(
        capture,
        intrinsics=intrinsics,
        fov=fov,
        poses=poses,
        unit=unit,
        keep_field=keep_field,
        progress=progress,
    )


@overload
def refine_many(
    images: PathLike | Iterable[ImageLike],
    prior_model: Model,
    *,
    same_scale: bool = ...,
    intrinsics: IntrinsicsLike | None = ...,
    fov: float | None = ...,
    return_exceptions: Literal[False] = ...,
    progress: Progress | None = ...,
    **settings: Any,
) -> Iterator[Result]: ...


@overload
def refine_many(
    images: PathLike | Iterable[ImageLike],
    prior_model: Model,
    *,
    same_scale: bool = ...,
    intrinsics: IntrinsicsLike | None = ...,
    fov: float | None = ...,
    return_exceptions: bool,
    progress: Progress | None = ...,
    **settings: Any,
) -> Iterator[Result | Error]: ...


def refine_many(
    images: PathLike | Iterable[ImageLike],
    prior_model: Model,
    *,
    same_scale: bool = False,
    intrinsics: IntrinsicsLike | None = None,
    fov: float | None = None,
    return_exceptions: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> Iterator[Result | Error]:
    """Refines photographs one after the other, each alone; with ``same_scale``, on one scale.

    The parameters are those of :class:`Refiner` (``settings``) and of :meth:`Refiner.refine_many`.

    Returns
    -------
    iterator of Result

    Raises
    ------
    Error
        For a setting at fault; for a photograph at fault at its step of the iterator.

    Examples
    --------
    >>> results = list(mdenerf.refine_many("burst", "network.onnx", same_scale=True))     # doctest: +SKIP
    """
    return Refiner(prior_model, **settings).refine_many(
        images,
        same_scale=same_scale,
        intrinsics=intrinsics,
        fov=fov,
        return_exceptions=return_exceptions,
        progress=progress,
    )
