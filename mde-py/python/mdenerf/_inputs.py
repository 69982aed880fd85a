"""What a run is given, as the native module takes it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from . import _mdenerf as native
from ._arrays import Floats, ImageLike, PathLike, Views, depth_map, further, in_folder, is_path, numpy, photograph
from ._mdenerf import Error

Config: TypeAlias = "PathLike | Mapping[str, Any]"


#: Settings beside the preset and the configuration.
_USUAL: dict[str, Any] = {
    "seed": None,
    "no_nerf": False,
    "predictions": None,
    "depth_range": None,
    "max_size": None,
    "work_size": 1.5,
    "max_memory": 8.0,
    "interval": None,
    "calibration": None,
    "unit_of_poses": False,
    "keep_field": False,
}


def native_settings(preset: str, config: Config | None, **given: Any) -> native.Settings:
    seed = given.get("seed")
    if seed is not None and not 0 <= seed < 2**63:
        raise Error(f"seed is {seed}; give 0 to 2^63 - 1")
    text, form = _config(config)
    return native.Settings({**_USUAL, **given, "preset": preset, "config": text, "form": form})


def _config(config: Config | None) -> tuple[str, str]:
    if config is None:
        return "", "toml"
    if isinstance(config, Mapping):
        try:
            return json.dumps(config), "json"
        except (TypeError, ValueError) as error:
            raise Error(f"config: {error}; give numbers, texts, lists and dictionaries") from None
    text = os.fspath(config)
    return text, "toml" if isinstance(config, str) and ("=" in text or "\n" in text) else "file"


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


def map_prior(depth: PathLike | ArrayLike | None, kind: str | None, png_scale: float | None) -> native.Prior:
    if is_path(depth):
        return native.Prior.file(os.fspath(depth), kind, png_scale)
    return native.Prior.map(depth_map(depth, "prior_depth"), kind or "metric")


def known_depths(given: PathLike | ArrayLike, image: ImageLike) -> dict[str, Any]:
    """Known depths as a path, or as rows of column, row, depth, sigma."""
    name = os.fspath(image) if is_path(image) else "image"
    if is_path(given):
        return {"path": os.fspath(given), "rows": np.zeros((0, 4)), "photograph": name}
    known = numpy(given)
    if known.dtype.kind not in "fiu" or known.ndim != 2 or known.shape[1] not in (3, 4):
        raise Error(f"scale_from has the shape {list(known.shape)}; give [n, 3] or [n, 4]: column, row, depth, and sigma if known")
    rows = np.zeros((len(known), 4))
    rows[:, : known.shape[1]] = known
    return {"path": None, "rows": rows, "photograph": name}


def checked(model: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    """The callable with its prediction as a map of the image's size."""

    def predict(image: Floats) -> Floats:
        depth = depth_map(model(image), "prior_model")
        if depth.shape != image.shape[:2]:
            raise Error(
                f"prior_model: the depth is {depth.shape[1]}x{depth.shape[0]} but the image is {image.shape[1]}x{image.shape[0]} (width x "
                "height); resize the prediction to the image"
            )
        return depth

    return predict


def scene_of(image: ImageLike, views: Views | None, poses: ArrayLike | None) -> dict[str, Any]:
    """The photograph and the further ones, or the capture that they are of."""
    if is_path(views) and is_path(image) and poses is None and native.is_capture(os.fspath(views)):
        return _of_files(os.fspath(views), os.fspath(image))
    images = [image] if views is None else [image, *further(image, views)]
    return _of_photographs(images, ["image", *(f"views[{index}]" for index in range(len(images) - 1))], poses)


def capture_of(capture: Views, poses: ArrayLike | None) -> dict[str, Any]:
    """Every photograph of a capture."""
    images: Sequence[ImageLike]
    if isinstance(capture, (str, os.PathLike)):
        if poses is None and native.is_capture(os.fspath(capture)):
            return _of_files(os.fspath(capture), None)
        images = in_folder("capture", capture)
    else:
        images = capture
    if len(images) < 2:
        raise Error(f"capture: the number of photographs is {len(images)}; give two or more of one place")
    scene = _of_photographs(images, [f"capture[{index}]" for index in range(len(images))], poses)
    return {**scene, "input": os.fspath(capture)} if is_path(capture) else scene


def _of_files(capture: str, image: str | None) -> dict[str, Any]:
    """A capture in the files of another program; without an image, all of it."""
    given = {"path": capture, "image": image}
    return {"input": image or capture, "photographs": [], "unreadable": [], "capture": given}


def _of_photographs(images: Sequence[ImageLike], names: list[str], poses: ArrayLike | None) -> dict[str, Any]:
    """Photographs, with the names of those that are no files; a further one that can't be read is left out."""
    motions: list[Any] = [None] * len(images)
    if poses is not None:
        array = np.asarray(poses, dtype=np.float64)
        if array.shape != (len(images), 4, 4):
            raise Error(f"poses has the shape {list(array.shape)}; give {[len(images), 4, 4]}, in the order of the photographs")
        motions = array.tolist()
    read: list[dict[str, Any]] = []
    unreadable = []
    for image, name, pose in zip(images, names, motions, strict=True):
        try:
            name, pixels, focal = photograph(image, name)
        except Error as error:
            if not read or not is_path(image):
                raise
            unreadable.append((os.fspath(image), str(error)))
            continue
        read.append({"name": name, "image": pixels, "focal": focal, "pose": pose})
    return {"input": read[0]["name"], "photographs": read, "unreadable": unreadable, "capture": None}
