"""The refinement of photographs."""

from __future__ import annotations

import inspect
import json
import os
import warnings
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import (
    Floats,
    ImageLike,
    IntrinsicsLike,
    Model,
    PathLike,
    Views,
    depth_map,
    intrinsics as known_intrinsics,
    numpy,
    photograph,
    several,
    short_names,
)
from ._mdenerf import Error
from ._result import RefinementWarning, Result

#: Called with the stage's name, the steps done and the steps in all (0 where unknown). An exception cancels the run.
Progress: TypeAlias = Callable[[str, int, int], object]
Config: TypeAlias = "PathLike | Mapping[str, Any]"


class Refiner:
    """A depth model that stays loaded, with the settings of its runs.

    A refiner may be used by several threads at once, and pickled: the copy opens the network again.

    Parameters
    ----------
    model : path or callable, optional
        A network in an ONNX file, or a callable. The callable gets ``float32 [height, width, 3]``, sRGB in 0 to 1, and returns
        its prediction ``[height, width]`` as anything that NumPy understands, a tensor of PyTorch on any device among them. It is called
        in the thread that called :meth:`refine`, also for crops and mirror images (with the default settings, up to some 30 times); its
        exceptions pass through. Without a model, give :meth:`refine` a ``depth``.
    kind : {"metric", "depth", "disparity"}, optional
        Meaning of the values: metres, depth in an unknown unit, or 1/depth up to scale and shift (MiDaS, Depth Anything). By default that
        of the ONNX file's profile, and ``metric`` otherwise.
    profile : str, optional
        Name of the ONNX file's profile (``mde refine --help`` lists them); by default it is recognised.
    input_size : (int, int), optional
        Height and width of the network's input, pixels: for an ONNX file by default its profile's. For a callable it decides how many crops
        are worth their time; without it the size is taken for unknown.
    preset : {"paper", "default", "fast", "multi-view"}, optional
        By default ``default`` for one photograph, ``multi-view`` for several.
    config : path, str or dict, optional
        Settings that override those of the preset: a TOML file, TOML text, or a dictionary of tables such as
        ``{"augmentation": {"predictions": 5}}``.
    seed : int, optional
        Seed of all random draws; by default that of the settings, 0. The same seed gives the same bits with any number of threads.
    budget : float, optional
        Seconds for the model's predictions: only as many as fit, by the time of the first one.
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
        Refuse runs whose estimated memory exceeds this, GiB. That of the model's own inference is not included.
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
        model: Model | None = None,
        *,
        kind: str | None = None,
        profile: str | None = None,
        input_size: tuple[int, int] | None = None,
        preset: str | None = None,
        config: Config | None = None,
        seed: int | None = None,
        budget: float | None = None,
        runtime: str = "auto",
        onnxruntime: PathLike | None = None,
        max_size: int | None = None,
        work_size: float = 1.5,
        max_memory: float = 8.0,
        interval: float | None = None,
        calibration: PathLike | None = None,
        threads: int | None = None,
    ) -> None:
        self._model = model
        self._kind = kind
        self._profile = profile
        self._input_size = input_size
        self._preset = preset
        self._config = config
        self._seed = seed
        self._budget = budget
        self._runtime = runtime
        self._library = onnxruntime
        self._max_size = max_size
        self._work_size = work_size
        self._max_memory = max_memory
        self._interval = interval
        self._calibration = calibration
        self._threads = threads
        self._settings(False, None)
        self._error_bar = self._open_error_bar()
        self._prior = self._open()

    def _open_error_bar(self) -> native.ErrorBar:
        calibration = None if self._calibration is None else os.fspath(self._calibration)
        return native.ErrorBar(self._interval, calibration)

    def _open(self) -> native.Prior | None:
        model = self._model
        if model is None:
            return None
        if isinstance(model, (str, os.PathLike)):
            library = _library(self._runtime) if self._library is None else os.fspath(self._library)
            form = (self._profile, self._input_size, self._kind)
            return native.Prior.network(os.fspath(model), form, self._runtime, library, self._threads)
        if not callable(model):
            raise Error(f"model is of {type(model).__name__}; give the path of an ONNX file, or a callable")
        name = getattr(model, "__qualname__", type(model).__name__)
        return native.Prior.callable(name, self._kind or "metric", self._input_size)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_prior", "_error_bar")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._error_bar = self._open_error_bar()
        self._prior = self._open()

    def _settings(self, many: bool, seed: int | None) -> native.Settings:
        preset = self._preset or ("multi-view" if many else "default")
        seed = self._seed if seed is None else seed
        return _settings(preset, self._config, seed, self._budget)

    @property
    def runtime(self) -> str | None:
        """What runs the ONNX file; None for a callable."""
        return None if self._prior is None else self._prior.runtime

    def refine(
        self,
        image: ImageLike,
        *,
        depth: PathLike | ArrayLike | None = None,
        intrinsics: IntrinsicsLike | None = None,
        fov: float | None = None,
        views: Views | None = None,
        poses: ArrayLike | None = None,
        unit: str = "prior",
        scale_from: PathLike | ArrayLike | None = None,
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
        depth : path or ndarray, optional
            In the place of a model, a depth map of the image, ``[height, width]``; 0 where missing.
        intrinsics : ndarray, dict or path, optional
            The camera of the photograph as given, pixels: a matrix ``[3, 3]``, ``fx``, ``fy``, ``cx``, ``cy`` by name, or a file with either. By
            default from EXIF, else a horizontal field of view of 60 degrees.
        fov : float, optional
            Instead of intrinsics, the horizontal field of view, degrees.
        views : sequence of images, or path, optional
            Further photographs of the same static scene, or a folder of them, with the same intrinsics where these are given. Or a
            capture with poses that ``image`` is a photograph of: ``transforms.json``, the folder of a COLMAP model or of a TUM sequence.
        poses : ndarray, optional
            World to camera, ``[photographs, 4, 4]``, that of ``image`` first; by default those of the capture, else they are estimated.
        unit : {"prior", "poses"}
            Unit of the result.
        scale_from : ndarray or path, optional
            Depths that are known at some pixels and give the result its scale: ``[n, 3]`` or ``[n, 4]`` of column, row, depth and standard
            deviation (0 where unknown), in pixels of the photograph as given (centres at integers) and metres. Or a CSV file of these, or the
            folder of a COLMAP model that has the photograph, whose unit the result then has. The error of the scale is in sigma.
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
        if (depth is None) == (self._prior is None):
            raise Error("give a model or a depth, and not both: the depth that is refined")
        if depth is not None and views is not None:
            raise Error("depth is that of one photograph; give a model to use views")
        if unit not in ("prior", "poses"):
            raise Error(f"unit is {unit!r}; give prior or poses")
        if poses is not None and views is None:
            raise Error("poses are given but no views; give the further photographs too")
        if scale_from is not None and unit != "prior":
            raise Error("scale_from gives the unit of the result; leave unit out")
        prior = self._prior if self._prior is not None else _map_prior(depth, self._kind)
        settings = self._settings(views is not None, seed)
        photographs, file, captured = _photographs(image, intrinsics, fov, views, poses, settings.max_views)
        if unit == "poses" and any(one["pose"] is None for one in photographs):
            raise Error("unit is 'poses', but the photographs have none; give poses or a capture with them, or unit='prior'")
        arguments = {
            "photographs": photographs,
            "fov": None if captured else fov,
            "camera_file": file,
            "unit_of_poses": unit == "poses",
            "scale_from": None if scale_from is None else _known_depths(scale_from, image),
            "max_size": self._max_size,
            "work_size": self._work_size,
            "max_memory": self._max_memory,
            "threads": self._threads,
        }
        model = _checked(self._model) if callable(self._model) else None
        result = Result._of(native.refine(prior, settings, self._error_bar, arguments, model, progress))
        for warning in result.run["warnings"]:
            warnings.warn(warning, RefinementWarning, stacklevel=_callers())
        return result

    __call__ = refine


def refine(
    image: ImageLike,
    model: Model | None = None,
    *,
    depth: PathLike | ArrayLike | None = None,
    kind: str | None = None,
    profile: str | None = None,
    input_size: tuple[int, int] | None = None,
    preset: str | None = None,
    config: Config | None = None,
    intrinsics: IntrinsicsLike | None = None,
    fov: float | None = None,
    views: Views | None = None,
    poses: ArrayLike | None = None,
    unit: str = "prior",
    scale_from: PathLike | ArrayLike | None = None,
    interval: float | None = None,
    calibration: PathLike | None = None,
    seed: int | None = None,
    budget: float | None = None,
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
    ``model`` or ``depth``.

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
    >>> mdenerf.refine("photo.jpg", depth="depth.npy", fov=65)                   # doctest: +SKIP
    >>> mdenerf.refine("photo.jpg", "network.onnx", interval=0.9).lower          # doctest: +SKIP
    >>> mdenerf.refine("a.jpg", "network.onnx", views=["b.jpg", "c.jpg"])        # doctest: +SKIP
    """
    refiner = Refiner(
        model,
        kind=kind,
        profile=profile,
        input_size=input_size,
        preset=preset,
        config=config,
        seed=seed,
        budget=budget,
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
        depth=depth,
        intrinsics=intrinsics,
        fov=fov,
        views=views,
        poses=poses,
        unit=unit,
        scale_from=scale_from,
        progress=progress,
    )


def _callers() -> int:
    """The number of frames of this package on the stack, for a warning at the caller's line."""
    frame, count = inspect.currentframe(), 0
    while frame is not None and frame.f_globals.get("__package__") == __package__:
        frame, count = frame.f_back, count + 1
    return count


def _settings(preset: str, config: Config | None, seed: int | None, budget: float | None) -> native.Settings:
    if seed is not None and not 0 <= seed < 2**63:
        raise Error(f"seed is {seed}; give 0 to 2^63 - 1")
    if config is None:
        return native.Settings(preset, "", False, "config", seed, budget)
    if isinstance(config, Mapping):
        try:
            text = json.dumps(config)
        except (TypeError, ValueError) as error:
            raise Error(f"config: {error}; give numbers, texts, lists and dictionaries") from None
        return native.Settings(preset, text, True, "config", seed, budget)
    text = os.fspath(config)
    if isinstance(config, str) and ("=" in text or "\n" in text):
        return native.Settings(preset, text, False, "config", seed, budget)
    return native.Settings.from_file(preset, text, seed, budget)


def _library(runtime: str) -> str | None:
    """ONNX Runtime's library of the package ``onnxruntime``."""
    if runtime == "tract":
        return None
    if path := os.environ.get("ORT_DYLIB_PATH"):
        return path
    spec = find_spec("onnxruntime")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for pattern in ("libonnxruntime.so*", "libonnxruntime*.dylib", "onnxruntime.dll"):
            if found := sorted(Path(folder, "capi").glob(pattern)):
                return str(found[0])
    return None


def _map_prior(depth: PathLike | ArrayLike | None, kind: str | None) -> native.Prior:
    if isinstance(depth, (str, os.PathLike)):
        return native.Prior.file(os.fspath(depth), kind)
    return native.Prior.map(depth_map(depth, "depth"), kind or "metric")


def _known_depths(given: PathLike | ArrayLike, image: ImageLike) -> dict[str, Any]:
    """Known depths as a path, or as rows of column, row, depth, sigma."""
    photograph = os.fspath(image) if isinstance(image, (str, os.PathLike)) else "image"
    rows = np.zeros((0, 4))
    if isinstance(given, (str, os.PathLike)):
        return {"path": os.fspath(given), "rows": rows, "photograph": photograph}
    known = numpy(given)
    if known.dtype.kind not in "fiu" or known.ndim != 2 or known.shape[1] not in (3, 4):
        raise Error(f"scale_from has the shape {list(known.shape)}; give [n, 3] or [n, 4]: column, row, depth, and sigma if known")
    rows = np.zeros((len(known), 4))
    rows[:, : known.shape[1]] = known
    return {"path": None, "rows": rows, "photograph": photograph}


def _checked(model: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    """The callable with its prediction as a map of the image's size."""

    def predict(image: Floats) -> Floats:
        depth = depth_map(model(image), "model")
        if depth.shape != image.shape[:2]:
            raise Error(
                f"model: the depth is {depth.shape[1]}x{depth.shape[0]} but the image is {image.shape[1]}x{image.shape[0]} (width x "
                "height); resize the prediction to the image"
            )
        return depth

    return predict


def _photographs(
    image: ImageLike,
    intrinsics: IntrinsicsLike | None,
    fov: float | None,
    views: Views | None,
    poses: ArrayLike | None,
    max_views: int,
) -> tuple[list[dict[str, Any]], str | None, bool]:
    """The photograph and the further ones, the file that their cameras are from, and whether it is a capture."""
    if isinstance(views, (str, os.PathLike)) and poses is None:
        captured = _capture(image, intrinsics, fov, os.fspath(views), max_views)
        if captured is not None:
            return captured, os.fspath(views), True
    found = [photograph(image, "image")] if views is None else several(image, views)
    motions: list[list[float] | None] = [None] * len(found)
    if poses is not None:
        array = np.asarray(poses, dtype=np.float64)
        if array.shape != (len(found), 4, 4):
            raise Error(f"poses has the shape {list(array.shape)}; give {[len(found), 4, 4]}, that of the image first")
        motions = [native.rigid_motion(f"poses[{index}]", matrix.tolist()) for index, matrix in enumerate(array)]
    file = os.fspath(intrinsics) if isinstance(intrinsics, (str, os.PathLike)) else None
    photographs = [
        {
            "name": name,
            "image": pixels,
            "focal": focal,
            "intrinsics": known_intrinsics(intrinsics, *pixels.shape[:2]),
            "mask": None,
            "pose": pose,
        }
        for (name, pixels, focal), pose in zip(found, motions, strict=True)
    ]
    return photographs, file, False


def _capture(
    image: ImageLike, intrinsics: IntrinsicsLike | None, fov: float | None, path: str, max_views: int
) -> list[dict[str, Any]] | None:
    """The photographs of a capture with poses; None where the path holds none."""
    if not isinstance(image, (str, os.PathLike)):
        return None
    known = None
    if intrinsics is not None:
        height, width = photograph(image, "image")[1].shape[:2]
        known = known_intrinsics(intrinsics, height, width)
    found = native.read_capture(path, os.fspath(image), known, fov, 4 * max_views)
    if found is None:
        return None
    names = short_names([name for name, *_ in found[0]])
    return [
        {"name": name, "image": pixels, "focal": None, "intrinsics": camera, "mask": mask, "pose": pose}
        for name, (_, pixels, mask, camera, pose) in zip(names, found[0], strict=True)
    ]
