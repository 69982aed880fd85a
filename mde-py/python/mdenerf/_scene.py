"""The results of every photograph of a scene."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from dataclasses import field as part
from pathlib import Path
from typing import Any, overload

import numpy as np

from . import _mdenerf as native
from ._arrays import Doubles, PathLike
from ._result import Result, in_place, pages, write_record


@dataclass(eq=False)
class Scene(Sequence[Result]):
    """Every photograph of a scene refined, on one scale: a sequence of :class:`Result`.

    Attributes
    ----------
    results : list of Result
        In the order of the photographs, without those that were left out.
    names : list of str
        Names of their photographs.
    poses : list of ndarray or None
        World to camera of each, ``float64 [4, 4]``, in the unit of the results. The world is the frame of one of the cameras, or
        in the unit of given poses their world. None for one that was refined alone, since the others carry no depth for it.
    run : dict
        The record of the run, with the keys of the program's ``run.json``: ``photographs`` has for each why it was refined alone
        (``reason``) or left out (``error``), the share of its pixels that another one confirms (``verified``, 0 to 1), its median of
        sigma / depth (``sigma``) and its ``seconds``.
    """

    results: list[Result]
    names: list[str]
    poses: list[Doubles | None]
    run: dict[str, Any]
    #: As quaternion and translation: a matrix would lose bits.
    _motions: list[list[float] | None] = part(default_factory=list, repr=False)

    @classmethod
    def _of(cls, parts: dict[str, Any]) -> Scene:
        run = json.loads(parts["run"])
        poses = parts["poses"]
        return cls(
            results=[Result._of(one) for one in parts["results"]],
            names=[row["photograph"] for row in run["photographs"] if row["folder"]],
            poses=[None if pose is None else np.array(pose[1]) for pose in poses],
            run=run,
            _motions=[None if pose is None else pose[0] for pose in poses],
        )

    @overload
    def __getitem__(self, index: int) -> Result: ...

    @overload
    def __getitem__(self, index: slice) -> list[Result]: ...

    def __getitem__(self, index: int | slice) -> Result | list[Result]:
        return self.results[index]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    @property
    def unit(self) -> str:
        """The unit of maps and poses: ``m``, ``unscaled`` or ``capture``."""
        return str(self.run["unit"])

    def save(
        self,
        folder: PathLike,
        *,
        export: str | Sequence[str] = (),
        force: bool = False,
        report: bool = True,
    ) -> Path:
        """Writes a folder for each photograph, as :meth:`Result.save` does, and the files of all, as ``mde dense`` does.

        ``cloud.ply`` has the points that two photographs confirm, ``transforms.json`` cameras, poses, depths and sigmas for nerfstudio, both
        with the program's bytes; ``run.json`` is the record, ``index.html`` the page. The folder appears whole or not at all.

        Parameters
        ----------
        folder : path
            The new folder.
        export : sequence of str
            Also write files for other programs into the folder of each photograph, as in :meth:`Result.save`; ``colmap-dense`` and ``mesh`` are of all.
        force : bool
            Replace the folder of an earlier run.
        report : bool
            Also write ``index.html``, and ``report.html`` of each photograph, with the program of this package.

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
        of_each = [name for name in formats if name not in ("colmap-dense", "mesh")]
        names = [row["folder"] for row in self.run["photographs"] if row["folder"]]

        def write(made: Path) -> None:
            for name, result in zip(names, self.results, strict=True):
                (made / name).mkdir()
                result._write(made / name, of_each)
            parts = [
                {
                    "folder": name,
                    "image": result._photograph(),
                    "camera": astuple(result.camera),
                    "pose": motion,
                    "depth": result.depth,
                    "sigma": result.sigma,
                }
                for name, result, motion in zip(names, self.results, self._motions, strict=True)
                if motion is not None
            ]
            points = native.save_all(str(made), parts, self.unit, formats)
            write_record(made, {**self.run, "points": points})
            if report:
                pages(made)
            for name in names:
                native.list_files(str(made / name))

        return in_place(folder, force, write)

    def __repr__(self) -> str:
        placed = sum(pose is not None for pose in self.poses)
        return f"Scene({len(self)} photographs, {placed} with a pose, unit {self.unit})"
