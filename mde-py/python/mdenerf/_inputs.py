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
from ._arrays import Floats, ImageLike, PathLike, Views, depth_map, is_path, numpy, photograph, several
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


def scene_of(image: ImageLike, views: Views | None, poses: ArrayLike | None, every: bool) -> dict[str, Any]:
    """The photograph and the further ones, or the capture that they are of; with ``every``, all of it."""
    if is_path(views) and is_path(image) and poses is None and native.is_capture(os.fspath(views)):
        capture = {"path": os.fspath(views), "image": os.fspath(image), "all": every}
        return {"photographs": [], "capture": capture}
    found = [photograph(image, "image")] if views is None else several(image, views)
    motions: list[Any] = [None] * len(found)
    if poses is not None:
        array = np.asarray(poses, dtype=np.float64)
        if array.shape != (len(found), 4, 4):
            raise Error(f"poses has the shape {list(array.shape)}; give {[len(found), 4, 4]}, that of the image first")
        motions = array.tolist()
    described = [
        {"name": name, "image": pixels, "focal": focal, "pose": pose}
        for (name, pixels, focal), pose in zip(found, motions, strict=True)
    ]
    return {"photographs": described, "capture": None}
