"""What a run is given, as the native module takes it."""

from __future__ import annotations

import json
import os
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

Config: TypeAlias = "PathLike | Mapping[str, Any]"


#: Settings with arguments of their own.
_SHORT: dict[str, Any] = {"seed": None, "no_nerf": False, "predictions": None, "near": None, "far": None}


def native_settings(preset: str, config: Config | None, **given: Any) -> native.Settings:
    short = {**_SHORT, **given}
    seed = short["seed"]
    if seed is not None and not 0 <= seed < 2**63:
        raise Error(f"seed is {seed}; give 0 to 2^63 - 1")
    if config is None:
        return native.Settings(preset, "", False, "config", short)
    if isinstance(config, Mapping):
        try:
            text = json.dumps(config)
        except (TypeError, ValueError) as error:
            raise Error(f"config: {error}; give numbers, texts, lists and dictionaries") from None
        return native.Settings(preset, text, True, "config", short)
    text = os.fspath(config)
    if isinstance(config, str) and ("=" in text or "\n" in text):
        return native.Settings(preset, text, False, "config", short)
    return native.Settings.from_file(preset, text, short)


def library_of(runtime: str) -> str | None:
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


def map_prior(
    depth: PathLike | ArrayLike | None, kind: str | None, png_scale: float | None, encoding: str
) -> native.Prior:
    if isinstance(depth, (str, os.PathLike)):
        return native.Prior.file(os.fspath(depth), kind, png_scale, encoding)
    return native.Prior.map(depth_map(depth, "depth"), kind or "metric")


def known_depths(given: PathLike | ArrayLike, image: ImageLike) -> dict[str, Any]:
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


def checked(model: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
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


class CameraOf:
    """The camera of photographs as the caller gave it."""

    def __init__(self, intrinsics: IntrinsicsLike | None, base: int, fov: float | None) -> None:
        if base not in (0, 1):
            raise Error(f"intrinsics_base is {base}; give 0 or 1, the index of the first pixel")
        if base and intrinsics is None:
            raise Error("intrinsics_base is given but no intrinsics; give them too")
        self._given = intrinsics
        self._base = base
        self.fov = fov
        #: The file that the intrinsics are from.
        self.file = os.fspath(intrinsics) if isinstance(intrinsics, (str, os.PathLike)) else None

    @property
    def is_given(self) -> bool:
        """Whether there are intrinsics."""
        return self._given is not None

    def of(self, height: int, width: int) -> list[float] | None:
        """fx, fy, cx, cy of a photograph of that size, pixels from 0."""
        found = known_intrinsics(self._given, height, width)
        return found and [*found[:2], found[2] - self._base, found[3] - self._base]


def photographs_and_camera(
    image: ImageLike,
    camera: CameraOf,
    views: Views | None,
    poses: ArrayLike | None,
    most: int | None,
) -> tuple[list[dict[str, Any]], str | None, bool]:
    """The photograph and the further ones (of a capture, at most so many), the file that their cameras are from, and whether it is one."""
    if isinstance(views, (str, os.PathLike)) and poses is None:
        captured = _capture(image, camera, os.fspath(views), most)
        if captured is not None:
            return captured, os.fspath(views), True
    found = [photograph(image, "image")] if views is None else several(image, views)
    motions: list[list[float] | None] = [None] * len(found)
    if poses is not None:
        array = np.asarray(poses, dtype=np.float64)
        if array.shape != (len(found), 4, 4):
            raise Error(f"poses has the shape {list(array.shape)}; give {[len(found), 4, 4]}, that of the image first")
        motions = [native.rigid_motion(f"poses[{index}]", matrix.tolist()) for index, matrix in enumerate(array)]
    described = [
        {
            "name": name,
            "image": pixels,
            "focal": focal,
            "intrinsics": camera.of(*pixels.shape[:2]),
            "mask": None,
            "pose": pose,
        }
        for (name, pixels, focal), pose in zip(found, motions, strict=True)
    ]
    return described, camera.file, False


def _capture(image: ImageLike, camera: CameraOf, path: str, most: int | None) -> list[dict[str, Any]] | None:
    """The photographs of a capture with poses; None where the path holds none."""
    if not isinstance(image, (str, os.PathLike)):
        return None
    known = None
    if camera.is_given:
        height, width = photograph(image, "image")[1].shape[:2]
        known = camera.of(height, width)
    found = native.read_capture(path, os.fspath(image), known, camera.fov, most)
    if found is None:
        return None
    names = short_names([name for name, *_ in found[0]])
    return [
        {"name": name, "image": pixels, "focal": None, "intrinsics": lens, "mask": mask, "pose": pose}
        for name, (_, pixels, mask, lens, pose) in zip(names, found[0], strict=True)
    ]
