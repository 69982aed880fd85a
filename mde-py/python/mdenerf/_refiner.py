"""The refinement of photographs, with a model that stays loaded."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import astuple
from typing import Any, Literal, TypeAlias, overload

from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import Floats, ImageLike, IntrinsicsLike, Model, PathLike, Views, callers, camera, is_path
from ._inputs import Config, capture_of, checked, known_depths, library_of, map_prior, native_settings, scene_of
from ._many import SameScale, photographs_of, refine_each, scales_of
from ._mdenerf import Error
from ._result import RefinementWarning, Result
from ._scene import Scene

#: Called with the stage's name, the steps done and the steps in all (0 where unknown). An exception cancels the run.
Progress: TypeAlias = Callable[[str, int, int], object]


class Refiner:
    """A depth model that stays loaded, with the settings of its runs.

    A refiner may be used by several threads at once, and pickled: the copy opens the network again.

    Parameters
    ----------
    prior_model : path or callable, optional
        A network in an ONNX file, or a callable. The callable gets ``float32 [height, width, 3]``, sRGB in 0 to 1, and returns
        its prediction ``[height, width]`` as anything that NumPy understands, a tensor of PyTorch on any device among them. It is called
        in the thread that called :meth:`refine`, also for crops and mirror images (with the default settings up to 30 times); its exceptions
        pass through. Without a model, give :meth:`refine` a ``prior_depth``, or several photographs: their parallax then gives the depth, in
        the unit of their poses, or without poses in a unit of its own.
    prior_kind : {"metric", "depth", "disparity"}, optional
        Meaning of the values: metres, depth in an unknown unit, or 1/depth up to scale and shift (MiDaS, Depth Anything). By default that
        of the ONNX file's profile, and ``metric`` otherwise.
    model_profile : str or path, optional
        Name of the ONNX file's profile (``mde refine --help`` lists them), or a ``.toml`` file with its input and output; by default it is
        recognised.
    preset : {"paper", "default", "fast", "multi-view"}, optional
        By default ``default`` for one photograph, ``multi-view`` for several.
    config : path, str or dict, optional
        Settings that override those of the preset: a TOML file, TOML text, or a dictionary of tables such as
        ``{"augmentation": {"predictions": 5}}``.
    seed : int, optional
        Seed of all random draws; by default that of the settings, 0. The same seed gives the same bits with any number of threads.
    predictions : int or "auto", optional
        Predictions of the model at most, on the photograph, its mirror image and crops; 1 is the photograph alone. By default that of the
        settings.
    no_nerf : bool
        Fit no field: the model's prediction, with the configured augmentation, is the result.
    depth_range : (float, float), optional
        Nearest and farthest depth of the scene, metres, for disparity of unknown scale and shift; by default those of the settings, 0.8 and 8.
    runtime : {"auto", "tract", "onnxruntime"}
        What runs an ONNX file. ``auto`` takes ONNX Runtime where the package ``onnxruntime`` is installed, else tract, which is part of this
        package. The program's default is tract; the two differ in the last bits.
    onnxruntime : path, optional
        ONNX Runtime's library; by default that of the package ``onnxruntime``.
    max_size : int, optional
        Resize photographs to this longer side, pixels.
    work_size : float
        Refine larger photographs at this many million pixels. The maps of one photograph are brought back to its own size with the
        edges of the photograph; those of several are not.
    max_memory : float
        Refuse runs whose estimated memory exceeds this, GiB. That of an ONNX file's inference is included, a callable's own is not.
    interval : float, optional
        Give each pixel an interval that is meant to contain the true depth with this probability, 0.01 to 0.99: ``Result.lower`` and
        ``Result.upper``.
    calibration : path, optional
        A calibration file of ``mde calibrate``: it scales sigma and intervals. By default that of the package where the model is the one
        it was estimated with; else intervals assume normally distributed errors.
    threads : int, optional
        Number of threads; by default one per core.

    Raises
    ------
    Error
        For a model that can't be opened, or a setting out of range.

    Examples
    --------
    >>> refiner = mdenerf.Refiner("network.onnx")               # doctest: +SKIP
    >>> results = [refiner.refine(path) for path in paths]      # doctest: +SKIP
    """

    def __init__(
        self,
        prior_model: Model | None = None,
        *,
        prior_kind: str | None = None,
        model_profile: PathLike | None = None,
        preset: str | None = None,
        config: Config | None = None,
        seed: int | None = None,
        predictions: int | Literal["auto"] | None = None,
        no_nerf: bool = False,
        depth_range: tuple[float, float] | None = None,
        runtime: str = "auto",
        onnxruntime: PathLike | None = None,
        max_size: int | None = None,
        work_size: float = 1.5,
        max_memory: float = 8.0,
        interval: float | None = None,
        calibration: PathLike | None = None,
        threads: int | None = None,
    ) -> None:
        self._model = prior_model
        self._kind = prior_kind
        self._profile = model_profile
        self._preset = preset
        self._config = config
        self._given: dict[str, Any] = {
            "seed": seed,
            "no_nerf": no_nerf,
            "predictions": None if predictions is None else str(predictions),
            "depth_range": depth_range,
            "max_size": max_size,
            "work_size": work_size,
            "max_memory": max_memory,
            "interval": interval,
            "calibration": None if calibration is None else os.fspath(calibration),
        }
        self._runtime = runtime
        self._library = onnxruntime
        self._threads = threads
        self._settings(False, None)
        self._prior = self._open()

    def _open(self) -> native.Prior:
        model = self._model
        if model is None:
            return native.Prior.nothing()
        if is_path(model):
            library = library_of(self._runtime) if self._library is None else os.fspath(self._library)
            profile = None if self._profile is None else os.fspath(self._profile)
            return native.Prior.network(os.fspath(model), profile, self._kind, self._runtime, library, self._threads)
        if not callable(model):
            raise Error(f"prior_model is of {type(model).__name__}; give the path of an ONNX file, or a callable")
        name = getattr(model, "__qualname__", type(model).__name__)
        return native.Prior.callable(name, self._kind or "metric")

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_prior"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._prior = self._open()

    def _settings(self, many: bool, seed: int | None, **given: Any) -> native.Settings:
        preset = self._preset or ("multi-view" if many else "default")
        own = {} if seed is None else {"seed": seed}
        return native_settings(preset, self._config, **{**self._given, **own, **given})

    @property
    def runtime(self) -> str | None:
        """What runs the ONNX file; None for a callable."""
        return self._prior.runtime

    def refine(
        self,
        image: ImageLike,
        *,
        prior_depth: PathLike | ArrayLike | None = None,
        png_scale: float | None = None,
        intrinsics: IntrinsicsLike | None = None,
        fov: float | None = None,
        views: Views | None = None,
        poses: ArrayLike | None = None,
        unit: str = "prior",
        scale_from: PathLike | ArrayLike | None = None,
        same_scale: SameScale | None = None,
        keep_field: bool = False,
        seed: int | None = None,
        progress: Progress | None = None,
    ) -> Result:
        """Refines the depth of a photograph.

        The GIL is released meanwhile, and Ctrl-C cancels the run.

        Parameters
        ----------
        image : path, bytes, ndarray or PIL.Image.Image
            The photograph: a file, its bytes, ``uint8`` or ``uint16`` or floats in 0 to 1 of ``[height, width, 3]``, sRGB, or an image of Pillow. Files
            and Pillow's images are turned upright, and their EXIF has the focal length.
        prior_depth : path or ndarray, optional
            In the place of a model, a depth map of the image, ``[height, width]``; 0 where missing. Or a file of it: NPY, NPZ, PNG of 16 bits,
            PFM, EXR.
        png_scale : float, optional
            Depth = value / ``png_scale`` for a file; by default the scale in the metadata of a PNG, else 1000 for 16 bits and 1 for floats.
        intrinsics : ndarray, dict or path, optional
            The camera of the photograph as given, pixels: a matrix ``[3, 3]``, ``fx``, ``fy``, ``cx``, ``cy`` by name, or a file with either. By
            default from EXIF, else a field of view of 60 degrees along the longer side.
        fov : float, optional
            Instead of intrinsics, the horizontal field of view, degrees.
        views : sequence of images, or path, optional
            Further photographs of the same static scene, or a folder of them, with the same intrinsics where these are given. Or a
            capture with poses that ``image`` is a photograph of: ``transforms.json``, the folder of a COLMAP model or of a TUM sequence. A file
            that can't be read, or is the same picture as another, is left out with a warning. They need no model.
        poses : ndarray, optional
            World to camera, ``[photographs, 4, 4]``, that of ``image`` first; by default those of the capture, else they are estimated.
        unit : {"prior", "poses"}
            Unit of the result; without a model that of the poses.
        scale_from : ndarray or path, optional
            Depths that are known at some pixels and give the result its scale: ``[n, 3]`` or ``[n, 4]`` of column, row, depth and standard
            deviation (0 where unknown), in pixels of the photograph as given (centres at integers) and metres. Or a CSV file of these, or the
            folder of a COLMAP model that has the photograph, whose unit the result then has. The error of the scale is in sigma.
        same_scale : SameScale, optional
            The factor of this photograph among others of the place, of :meth:`same_scale`. Its error is in sigma.
        keep_field : bool
            Keep the fitted field of the last iteration: ``Result.field``, which :meth:`Result.save` writes.
        seed : int, optional
            Instead of the refiner's.
        progress : callable, optional
            Called as ``progress(stage, done, total)`` in this thread; ``total`` is 0 where it is unknown. An exception cancels the run and
            passes through.

        Returns
        -------
        Result

        Raises
        ------
        Error
            For an input, a setting or a stage at fault, in one line that names it and the remedy.
        KeyboardInterrupt
            After Ctrl-C.
        """
        if prior_depth is not None and self._model is not None:
            raise Error("give a prior_model or a prior_depth, and not both: the depth that is refined")
        if prior_depth is None and self._model is None and views is None:
            raise Error("one photograph needs a depth: give a prior_model or a prior_depth; several of one place (views) need none")
        if prior_depth is not None and views is not None:
            raise Error("prior_depth is that of one photograph; with views, give a prior_model or nothing")
        if poses is not None and views is None:
            raise Error("poses are given but no views; give the further photographs too")
        if scale_from is not None and unit != "prior":
            raise Error("scale_from gives the unit of the result; leave unit out")
        if same_scale is not None and (views is not None or scale_from is not None):
            raise Error("same_scale is for photographs that are refined alone; leave views and scale_from out")
        if png_scale is not None and not is_path(prior_depth):
            raise Error("png_scale is of a depth in a file; give prior_depth as a path, or leave it out")
        prior = self._prior if prior_depth is None else map_prior(prior_depth, self._kind, png_scale)
        arguments = self._arguments(scene_of(image, views, poses), camera(intrinsics, fov))
        arguments["scale_from"] = None if scale_from is None else known_depths(scale_from, image)
        arguments["same_scale"] = None if same_scale is None else astuple(same_scale)
        settings = self._settings(views is not None, seed, unit_of_poses=_unit(unit, arguments), keep_field=keep_field)
        made = native.refine(prior, settings, arguments, False, self._callable(), progress)
        result = Result._of(made["results"][0])
        for warning in result.run["warnings"]:
            warnings.warn(warning, RefinementWarning, stacklevel=callers())
        return result

    __call__ = refine

    def dense(
        self,
        capture: Views,
        *,
        intrinsics: IntrinsicsLike | None = None,
        fov: float | None = None,
        poses: ArrayLike | None = None,
        unit: str = "prior",
        keep_field: bool = False,
        seed: int | None = None,
        progress: Progress | None = None,
    ) -> Scene:
        """Refines the depth of every photograph of a static scene, as ``mde dense CAPTURE``; it needs no model.

        Predictions, poses and, among photographs that see the same, plane sweeps are computed once; each photograph then gets a field of
        its own. The maps of all are in memory until the end, some 40 bytes a pixel and photograph. A photograph that fails, that can't be
        read or that is the same picture as another is left out with a warning.

        Parameters
        ----------
        capture : path, or sequence of images
            A folder of photographs, or a capture with poses: ``transforms.json``, the folder of a COLMAP model or of a TUM sequence. Or the
            photographs themselves. The first gives the frame of the poses and the scale of all.
        intrinsics, fov, poses, unit
            As in :meth:`refine`; the poses in the order of the photographs, those of a folder in the order of names.
        keep_field : bool
            Keep the fitted field of each photograph: ``Result.field``.
        seed : int, optional
            Instead of the refiner's.
        progress : callable, optional
            As in :meth:`refine`, and as ``progress("photograph", done, total)`` after each.

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
        >>> scene = mdenerf.Refiner(no_nerf=True).dense("photos")              # doctest: +SKIP
        >>> scene[1].depth, scene.poses[1]                                     # doctest: +SKIP
        >>> scene.save("out/room")                                             # doctest: +SKIP
        """
        arguments = self._arguments(capture_of(capture, poses), camera(intrinsics, fov))
        settings = self._settings(True, seed, unit_of_poses=_unit(unit, arguments), keep_field=keep_field)
        scene = Scene._of(native.refine(self._prior, settings, arguments, True, self._callable(), progress))
        for warning in scene.run["warnings"]:
            warnings.warn(warning, RefinementWarning, stacklevel=callers())
        return scene

    def _arguments(self, photographs: dict[str, Any], camera: dict[str, Any]) -> dict[str, Any]:
        return {**photographs, "camera": camera, "scale_from": None, "same_scale": None, "threads": self._threads}

    def _callable(self) -> Callable[[Floats], Floats] | None:
        return checked(self._model) if callable(self._model) else None

    def same_scale(
        self,
        images: PathLike | Iterable[ImageLike],
        *,
        intrinsics: IntrinsicsLike | None = None,
        fov: float | None = None,
        seed: int | None = None,
        progress: Progress | None = None,
    ) -> list[SameScale]:
        """The factors that bring the model's depth of photographs of one place to one scale, as ``mde refine --same-scale``.

        A network gives photographs of one place depths that differ by a factor. Each photograph is matched with the three before it, and
        up to 16, evenly spread over all, with each other; up to 16 photographs thus need no order. It takes one prediction of each.

        Parameters
        ----------
        images : sequence of images, or path
            The photographs of a burst or the frames of a video in their order, or a folder of them, in the order of names.
        intrinsics, fov
            The camera of all, as in :meth:`refine`.
        seed : int, optional
            Instead of the refiner's.
        progress : callable, optional
            Called as ``progress("match", done, total)``, with photographs.

        Returns
        -------
        list of SameScale
            One for each photograph, for the argument ``same_scale`` of :meth:`refine`. One that can't be read, or that matches no other, has the
            factor 1.

        Raises
        ------
        Error
            For a setting at fault, where the refiner has no model, or where no photograph can be read.
        """
        if self._model is None:
            raise Error("same_scale needs a prior_model; a prior_depth is that of one photograph")
        found = photographs_of(images)
        settings = self._settings(False, seed)
        lens = camera(intrinsics, fov)

        def prepared(image: ImageLike) -> dict[str, Any]:
            return self._arguments(scene_of(image, None, None), lens)

        scale = native.OneScale(len(found), settings)
        return scales_of(scale, found, prepared, (self._prior, settings, self._callable(), self._threads), progress)

    @overload
    def refine_many(
        self,
        images: PathLike | Iterable[ImageLike],
        *,
        same_scale: bool = ...,
        intrinsics: IntrinsicsLike | None = ...,
        fov: float | None = ...,
        seed: int | None = ...,
        return_exceptions: Literal[False] = ...,
        progress: Progress | None = ...,
    ) -> Iterator[Result]: ...

    @overload
    def refine_many(
        self,
        images: PathLike | Iterable[ImageLike],
        *,
        same_scale: bool = ...,
        intrinsics: IntrinsicsLike | None = ...,
        fov: float | None = ...,
        seed: int | None = ...,
        return_exceptions: bool,
        progress: Progress | None = ...,
    ) -> Iterator[Result | Error]: ...

    def refine_many(
        self,
        images: PathLike | Iterable[ImageLike],
        *,
        same_scale: bool = False,
        intrinsics: IntrinsicsLike | None = None,
        fov: float | None = None,
        seed: int | None = None,
        return_exceptions: bool = False,
        progress: Progress | None = None,
    ) -> Iterator[Result | Error]:
        """Refines photographs one after the other, each alone.

        Each result is computed at the iterator's next step, so that one is in memory. For a data set, the program's ``mde refine FOLDER`` also
        resumes after a kill, and :mod:`mdenerf.ray` goes to many machines.

        Parameters
        ----------
        images : iterable of images, or path
            The photographs, or a folder of them, in the order of names.
        same_scale : bool
            First bring all to one scale, as :meth:`same_scale` does.
        intrinsics, fov, seed
            Those of all, as in :meth:`refine`.
        return_exceptions : bool
            For a photograph that fails, give its :class:`Error` in the place of a result, and go on.
        progress : callable, optional
            Called as ``progress("photograph", done, total)`` after each (``total`` is 0 where ``images`` has no length), and with
            ``same_scale`` before as ``progress("match", done, total)``.

        Returns
        -------
        iterator of Result
            In the order of the photographs.

        Raises
        ------
        Error
            For a setting at fault; for a photograph at fault at its step of the iterator.

        Examples
        --------
        >>> for path, result in zip(paths, refiner.refine_many(paths, same_scale=True)):     # doctest: +SKIP
        ...     result.save(f"out/{path.stem}")
        """
        if self._model is None:
            raise Error("refine_many needs a prior_model; a prior_depth is that of one photograph")
        given: dict[str, Any] = {"intrinsics": intrinsics, "fov": fov, "seed": seed}
        self._settings(False, seed)
        found = photographs_of(images) if same_scale or isinstance(images, (str, os.PathLike)) else images

        def scales(images: list[ImageLike]) -> list[SameScale]:
            return self.same_scale(images, **given, progress=progress)

        def one(image: ImageLike, factor: SameScale | None) -> Result:
            return self.refine(image, **given, same_scale=factor)

        return refine_each(found, scales if same_scale else None, one, return_exceptions, progress)


def _unit(unit: str, arguments: dict[str, Any]) -> bool:
    """Whether the results are in the unit of the poses."""
    if unit not in ("prior", "poses"):
        raise Error(f"unit is {unit!r}; give prior or poses")
    if unit == "poses" and any(one["pose"] is None for one in arguments["photographs"]):
        raise Error("unit is 'poses', but the photographs have none; give poses or a capture with them, or unit='prior'")
    return unit == "poses"
