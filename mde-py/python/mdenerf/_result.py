"""The result of a refinement."""

from __future__ import annotations

import base64
import html
import json
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from dataclasses import field as part
from pathlib import Path
from typing import Any

import numpy as np

from . import _mdenerf as native
from ._arrays import Bytes, Doubles, Floats, PathLike
from ._mdenerf import Error
from ._program import program

#: The file that marks the folder of an earlier run.
_RECORD = "run.json"
#: Width of the pictures in a notebook, pixels.
_SHOWN = 320


def in_place(folder: PathLike, force: bool, write: Callable[[Path], None]) -> Path:
    """The folder once ``write`` has filled it; it appears whole or not at all."""
    target = Path(folder)
    if target.exists() or target.is_symlink():
        if not target.is_dir():
            raise Error(f"{target}: exists and is not a folder; give another name")
        if not force:
            raise Error(f"{target}: the folder exists; give another name, or force=True to replace it")
        if any(target.iterdir()) and not _is_record(target / _RECORD):
            raise Error(f"{target}: not replaced, as it holds no {_RECORD} of an earlier run; give another name")
    try:
        target.absolute().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".mde-", dir=target.absolute().parent) as place:
            made = Path(place) / "new"
            made.mkdir()
            write(made)
            native.replace_folder(str(made), str(target))
    except OSError as error:
        raise Error(f"{target}: can't write ({error}); give another place") from error
    return target


def _is_record(path: Path) -> bool:
    try:
        record = json.loads(path.read_bytes()) if path.is_file() else None
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and "command" in record


def write_record(folder: Path, run: dict[str, Any]) -> None:
    """Writes the record of a run."""
    record = json.dumps(run, indent=2, ensure_ascii=False) + "\n"
    (folder / _RECORD).write_text(record, encoding="utf-8", newline="\n")


def pages(folder: Path) -> None:
    """Writes the pages of a folder, with the program."""
    made = subprocess.run([program(), "report", folder], capture_output=True, text=True, check=False)
    if made.returncode != 0:
        raise Error(made.stderr.strip().removeprefix("error: "))


class RefinementWarning(UserWarning):
    """What to know of a result: an assumed camera, a resized map, a doubtful model."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel centres are at integers, from 0.

    Attributes
    ----------
    fx, fy : float
        Focal lengths, pixels.
    cx, cy : float
        Principal point, pixels.
    width, height : int
        Size of the image, pixels.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def matrix(self) -> Doubles:
        """The intrinsic matrix, ``float64 [3, 3]``."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def points(self, depth: Floats) -> Floats:
        """The points of a depth map in the frame of the camera: x right, y down, z forward.

        Parameters
        ----------
        depth : ndarray
            ``[height, width]``.

        Returns
        -------
        ndarray
            ``float32 [height, width, 3]`` in the unit of the depth; 0 where it is missing.
        """
        rows, columns = np.indices(depth.shape, dtype=np.float32)
        x, y = (columns - self.cx) / self.fx * depth, (rows - self.cy) / self.fy * depth
        return np.stack([x, y, depth], axis=-1).astype(np.float32)


@dataclass(eq=False)
class Result:
    """Refined depth with its standard deviation.

    Attributes
    ----------
    depth : ndarray
        Refined depth z, ``float32 [height, width]``, in the prior's unit (``run["unit"]``); 0 where missing.
    sigma : ndarray
        Its standard deviation, in the same shape and unit; infinite where missing.
    prior : ndarray
        The monocular depth that it started from, in the same shape and unit; 0 where missing.
    camera : Camera
        The camera of these maps: given, from EXIF, assumed or estimated (``run["camera"]["source"]``).
    run : dict
        The record of the run, with the keys of the program's ``run.json``.
    image : ndarray
        The photograph at the size of the maps, ``uint8 [height, width, 3]``.
    config : str
        All settings of the run as TOML; ``refine(..., config=result.config)`` repeats it.
    components : dict of str to ndarray
        Components by the names of ``docs/outputs.md``, such as ``spread`` and ``disagreement`` of the predictions, ``common`` and ``field``.
        ``gauge``, and ``scale`` without ``scale_from``, are errors of the whole map: beside sigma, not in it.
    lower, upper : ndarray or None
        With ``interval``, the ends of the interval of each pixel, in the shape and unit of the depth; 0 and infinity where missing, and
        nowhere else. The probability and its source are in ``run["error_bar"]["interval"]``.
    field : bytes or None
        With ``keep_field``, the fitted field of the last iteration as a file, ``field.safetensors``, which ``mde render`` reads; None where none was fitted.
    evidence : dict of str to ndarray
        With several photographs, ``float32 [height, width]`` each: ``origin`` of the depth (0 none, 1 prior, 2 consensus, 3 field), how
        many photographs have ``seen`` and ``confirmed`` it. Empty otherwise.
    """

    depth: Floats
    sigma: Floats
    prior: Floats
    camera: Camera
    run: dict[str, Any]
    image: Bytes
    config: str
    components: dict[str, Floats] = part(default_factory=dict)
    evidence: dict[str, Floats] = part(default_factory=dict)
    lower: Floats | None = None
    upper: Floats | None = None
    field: bytes | None = None
    _pictures: dict[str, Bytes] = part(default_factory=dict, repr=False)
    #: Names, pictures, cameras and poses of the other photographs that were used.
    _others: list[tuple[str, Bytes, tuple[float, ...], list[float]]] = part(default_factory=list, repr=False)
    #: The photographs above the preview.
    _strip: list[Floats] = part(default_factory=list, repr=False)
    #: The photograph, where bytes do not hold it.
    _exact: Floats | None = part(default=None, repr=False)
    #: The network's own: larger where it is surer.
    _confidence: Floats | None = part(default=None, repr=False)
    #: The network's own: larger where it is less sure.
    _error: Floats | None = part(default=None, repr=False)
    #: Without the rounding of sigma.
    _variance: Floats = part(default_factory=lambda: np.zeros((0, 0), np.float32), repr=False)

    @classmethod
    def _of(cls, parts: dict[str, Any]) -> Result:
        return cls(**{**parts, "camera": Camera(*parts["camera"]), "run": json.loads(parts["run"])})

    @property
    def unit(self) -> str:
        """The unit of the maps: ``m``, ``unscaled`` or ``capture``."""
        return str(self.run["unit"])

    def save(
        self,
        folder: PathLike,
        *,
        export: str | Sequence[str] = (),
        force: bool = False,
        report: bool = True,
    ) -> Path:
        """Writes the maps, the photograph, the settings, the record and the report, as ``mde refine`` does.

        ``depth.npy``, ``sigma.npy``, ``prior.npy``, ``depth.png``, ``confidence.png``, ``image.png``, ``preview.png`` and ``config.toml`` have the
        bytes of the program's; with several photographs also ``evidence.npz`` and ``views/``, with an interval ``lower.npy`` and
        ``upper.npy``, with a kept field ``field.safetensors``. The folder appears whole or not at all.

        Parameters
        ----------
        folder : path
            The new folder.
        export : sequence of str
            Also write files for other programs, with the program's bytes: ``ply`` (``cloud.ply``, points with colour, normal and sigma), ``glb``
            (``mesh.glb``), ``exr`` (``depth.exr``), ``colmap`` (a folder with ``images`` and ``sparse/0``), ``transforms`` (``transforms.json``),
            ``sigma`` (the components of sigma).
        force : bool
            Replace the folder of an earlier run.
        report : bool
            Also write ``report.html``, with the program of this package.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        Error
            Where the folder exists, or can't be written.
        """
        formats = [export] if isinstance(export, str) else list(export)

        def write(made: Path) -> None:
            self._write(made, formats)
            if report:
                pages(made)
            native.list_files(str(made))

        return in_place(folder, force, write)

    def _write(self, folder: Path, formats: list[str]) -> None:
        if self._pictures:
            (folder / "views").mkdir()
        ends = (("lower", self.lower), ("upper", self.upper))
        parts = {
            "depth": self.depth,
            "variance": self._variance,
            "sigma": self.sigma,
            "prior": self.prior,
            "more": [(name, values) for name, values in ends if values is not None],
            "components": list(self.components.items()),
            "confidence": self._confidence,
            "error": self._error,
            "evidence": list(self.evidence.items()),
            "image": self._photograph(),
            "pictures": list(self._pictures.items()),
            "others": self._others,
            "strip": self._strip,
            "unit": self.unit,
            "camera": astuple(self.camera),
        }
        native.save_result(str(folder), parts, formats)
        if self.field is not None:
            (folder / "field.safetensors").write_bytes(self.field)
        (folder / "config.toml").write_text(self.config, encoding="utf-8", newline="\n")
        write_record(folder, self.run)

    def _photograph(self) -> Floats:
        """sRGB in 0 to 1."""
        return self.image.astype(np.float32) / np.float32(255) if self._exact is None else self._exact

    def __repr__(self) -> str:
        height, width = self.depth.shape
        known = np.isfinite(self.sigma)
        if not known.any():
            return f"Result({width}x{height}, no depth)"
        depth, sigma = np.median(self.depth[known]), np.median(self.sigma[known])
        return f"Result({width}x{height}, median depth {depth:.3g} {self.unit}, median sigma {sigma:.2g})"

    def _repr_html_(self) -> str:
        height, width = self.depth.shape
        step = max(1, -(-width // _SHOWN))
        depth, depths = native.picture(np.ascontiguousarray(self.depth[::step, ::step]), "depth")
        sigma, sigmas = native.picture(np.ascontiguousarray(self.sigma[::step, ::step]), "sigma")
        image = np.ascontiguousarray(self.image[::step, ::step])
        unit = html.escape(self.unit)

        def figure(picture: Bytes, title: str) -> str:
            data = base64.b64encode(native.encode_png(picture)).decode("ascii")
            return (
                '<figure style="display:inline-block;margin:4px">'
                f'<img src="data:image/png;base64,{data}" width="{min(width, _SHOWN)}" alt="{title}">'
                f"<figcaption>{title}</figcaption></figure>"
            )

        return "<div>" + "".join(
            (
                figure(image, f"image, {width}x{height}"),
                figure(depth, f"depth, {depths[0]:.3g} to {depths[1]:.3g} {unit}"),
                figure(sigma, f"sigma, {sigmas[0]:.2g} to {sigmas[1]:.2g} {unit}"),
            )
        ) + "</div>"
