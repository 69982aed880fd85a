"""What callers may give, as arrays."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _mdenerf as native
from ._mdenerf import Error

if TYPE_CHECKING:
    from PIL.Image import Image

Floats: TypeAlias = NDArray[np.float32]
Doubles: TypeAlias = NDArray[np.float64]
Bytes: TypeAlias = NDArray[np.uint8]
Mask: TypeAlias = NDArray[np.bool_]
PathLike: TypeAlias = "str | os.PathLike[str]"
ImageLike: TypeAlias = "PathLike | bytes | NDArray[Any] | Image"
IntrinsicsLike: TypeAlias = "PathLike | ArrayLike | Mapping[str, float]"
Model: TypeAlias = "PathLike | Callable[[Floats], Any]"
Views: TypeAlias = "PathLike | Sequence[ImageLike]"

#: A photograph: its name, sRGB in 0 to 1, and the focal length of its EXIF in millimetres of 35 mm film.
Photograph: TypeAlias = tuple[str, Floats, "float | None"]

_FOCAL_35MM = 0xA405
_EXIF = 0x8769


def is_path(value: object) -> TypeGuard[PathLike]:
    return isinstance(value, (str, os.PathLike))


def photograph(image: ImageLike, name: str) -> Photograph:
    """A photograph with its name: that of its file, else ``name``."""
    if is_path(image):
        path = os.fspath(image)
        pixels, focal = native.read_photo(path)
        return path, pixels, focal
    if isinstance(image, bytes):
        try:
            return name, *native.decode_photo(image)
        except Error as error:
            raise Error(f"{name}: {error}") from None
    focal = None
    if hasattr(image, "getexif"):  # Pillow's
        image, focal = _pillow(image)
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[2] != 3:
        raise Error(f"{name}: the image has the shape {list(array.shape)}; give [height, width, 3]")
    return name, _unit(array, name), focal


def _unit(array: NDArray[Any], name: str) -> Floats:
    """sRGB in 0 to 1."""
    if array.dtype in (np.uint8, np.uint16):
        most = np.float32(np.iinfo(array.dtype).max)
        return np.ascontiguousarray(array.astype(np.float32) / most)
    if array.dtype.kind != "f":
        raise Error(f"{name}: the image is of {array.dtype}; give uint8, uint16, or floats in 0 to 1")
    return np.ascontiguousarray(array, dtype=np.float32)


def _pillow(image: Any) -> tuple[NDArray[Any], float | None]:
    from PIL import ImageOps

    tags = image.getexif()
    millimetres = tags.get_ifd(_EXIF).get(_FOCAL_35MM) or tags.get(_FOCAL_35MM)
    upright = ImageOps.exif_transpose(image)
    return np.asarray(upright.convert("RGB")), float(millimetres) if millimetres else None


#: Extensions of photographs within a folder.
PHOTOGRAPHS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")


def in_folder(name: str, folder: PathLike) -> list[Path]:
    """The photographs of a folder in the order of their names; ``name`` is that of the argument."""
    place = Path(folder)
    if not place.is_dir():
        raise Error(f"{name} {place}: no such folder; give a folder of photographs, or a list of them")
    return sorted(path for path in place.iterdir() if path.suffix.lower() in PHOTOGRAPHS and path.is_file())


def further(image: ImageLike, views: Views) -> Sequence[ImageLike]:
    """The further photographs of the scene."""
    if isinstance(views, (str, os.PathLike)):
        paths = in_folder("views", views)
        reference = Path(image).resolve() if is_path(image) else None
        views = [path for path in paths if path.resolve() != reference]
    if not views:
        raise Error("views: no further photograph is there; give one or more, or leave views out")
    return views


def camera(given: IntrinsicsLike | None, fov: float | None) -> dict[str, Any]:
    """The camera of photographs: a file, fx, fy, cx, cy in pixels, or a horizontal field of view."""
    if given is not None and fov is not None:
        raise Error("intrinsics and fov are both given; give one of them")
    if isinstance(given, (str, os.PathLike)):
        return {"file": os.fspath(given), "intrinsics": None, "fov": None}
    return {"file": None, "intrinsics": None if given is None else _intrinsics(given), "fov": fov}


def _intrinsics(given: ArrayLike | Mapping[str, float]) -> list[float]:
    if isinstance(given, Mapping):
        missing = [key for key in ("fx", "fy", "cx", "cy") if key not in given]
        if missing:
            raise Error(f"intrinsics has no {missing[0]}; give fx, fy, cx and cy in pixels")
        return [float(given[key]) for key in ("fx", "fy", "cx", "cy")]
    matrix = np.asarray(given, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise Error(f"intrinsics has the shape {list(matrix.shape)}; give a 3x3 matrix, or fx, fy, cx and cy by name")
    if not np.allclose(matrix[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]], [0, 0, 0, 0, 1], atol=1e-6):
        raise Error("intrinsics is not the matrix of a pinhole camera; give [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return [float(value) for value in (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])]


def numpy(value: Any) -> NDArray[Any]:
    """Any array-like, a tensor on another device among them."""
    if hasattr(value, "detach"):
        value = value.detach().cpu()
        if "bfloat16" in str(getattr(value, "dtype", "")):
            # NumPy has no such floats.
            value = value.float()
    return np.asarray(value)


def depth_map(value: Any, name: str) -> Floats:
    """A map ``[height, width]``; axes of length 1 beside these two are dropped."""
    array = numpy(value)
    if array.dtype.kind not in "fiu":
        raise Error(f"{name}: the depth is of {array.dtype}; give floats")
    if array.ndim > 2 and array.size:
        array = array.reshape([side for side in array.shape if side != 1] or [1, 1])
    if array.ndim != 2:
        raise Error(f"{name}: the depth has the shape {list(numpy(value).shape)}; give [height, width]")
    return np.ascontiguousarray(array, dtype=np.float32)


def same_map(value: ArrayLike, shape: tuple[int, ...], name: str) -> Floats:
    """A map of that shape, or a number for all of it."""
    array = np.asarray(value, dtype=np.float32)
    if array.ndim == 0:
        return np.full(shape, array, dtype=np.float32)
    if array.shape != shape:
        raise Error(f"{name} has the shape {list(array.shape)} but the depth {list(shape)}; give both one shape")
    return np.ascontiguousarray(array)


def callers() -> int:
    """The number of frames of this package on the stack, for a warning at the caller's line."""
    frame, count = inspect.currentframe(), 0
    while frame is not None and frame.f_globals.get("__package__") == __package__:
        frame, count = frame.f_back, count + 1
    return count
