"""Refinement of data sets of any size with Ray Data.

>>> import ray, mdenerf.ray                                                             # doctest: +SKIP
>>> photographs = ray.data.read_binary_files("s3://bucket/photos", include_paths=True)  # doctest: +SKIP
>>> refined = photographs.map_batches(                                                  # doctest: +SKIP
...     mdenerf.ray.Refine, fn_constructor_kwargs={"prior_model": "network.onnx"}, batch_size=4, num_cpus=4,
...     compute=ray.data.ActorPoolStrategy(min_size=1, max_size=1000),
... )
>>> refined.write_parquet("s3://bucket/depth")                                          # doctest: +SKIP

Ray schedules the actors, restarts those that are lost and runs their batches again. The result of a photograph depends on its bytes and
the settings only, so that a batch that runs twice gives the same rows, but for ``seconds``.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._mdenerf import Error
from ._refiner import Refiner
from ._result import RefinementWarning, Result

__all__ = ["Refine", "pending", "read_map", "webdataset"]

Batch = dict[str, NDArray[Any]]

#: Files of earlier jobs that are read side by side.
_READERS = 16


class Refine:
    """An actor for ``Dataset.map_batches``: it keeps the network, and turns rows with photographs into rows with maps.

    A row has a photograph either as ``bytes``, the file (``ray.data.read_binary_files``), or as ``image``, ``uint8 [height, width, 3]``
    (``ray.data.read_images``). Files are decoded as the program decodes them, and have its focal length; arrays come without one. The name
    of a row is its ``path``, or the column ``name``.

    Rows of the result, one per photograph:

    ``name`` (str), ``status`` (``done`` or ``failed``), ``error`` (str, one line), ``depth`` and ``sigma`` (bytes, the files ``depth.npy``
    and ``sigma.npy`` of the program; :func:`read_map` reads them; empty where it failed), ``height``, ``width`` (int), ``unit`` (str),
    ``median_depth``, ``median_sigma``, ``seconds`` (float), ``run`` (str, the record as JSON). With the setting ``interval`` also ``lower`` and ``upper``
    (bytes, as ``depth``), the ends of the interval of each pixel.

    Parameters
    ----------
    prior_model, **settings
        Those of :class:`mdenerf.Refiner`. The number of threads is by default that of the actor's CPUs.
    fov : float, optional
        Horizontal field of view of all photographs, degrees.
    """

    def __init__(self, prior_model: Any = None, *, fov: float | None = None, **settings: Any) -> None:
        settings.setdefault("threads", _threads())
        self._refiner = Refiner(prior_model, **settings)
        self._ends = settings.get("interval") is not None
        self._fov = fov

    def __call__(self, batch: Batch) -> Batch:
        """Refines the photographs of a batch, one after the other; one that fails, for whatever reason, is a row too."""
        names = batch[_either(batch, "name", "path", "give include_paths=True to the function that reads them")]
        images = batch[_either(batch, "bytes", "image", "read them with ray.data.read_binary_files or ray.data.read_images")]
        rows = [self._row(str(name), image) for name, image in zip(names, images, strict=True)]
        return {key: _column([row[key] for row in rows]) for key in rows[0]} if rows else {}

    def _row(self, name: str, image: Any) -> dict[str, Any]:
        begun = time.monotonic()
        try:
            result, error = self._refine(image), ""
        except Error as failure:
            result, error = None, str(failure)
        except Exception as failure:
            # Of one photograph, such as a lack of memory: not the end of the job.
            result, error = None, " ".join(f"{type(failure).__name__}: {failure}".split())
        seconds = time.monotonic() - begun
        row: dict[str, Any] = {"name": name, "status": "failed" if result is None else "done", "error": error}
        ends = _ends(result) if self._ends else {}
        return {**row, **_columns(result), **ends, "seconds": seconds}

    def _refine(self, image: Any) -> Result:
        with warnings.catch_warnings():
            # The record has them.
            warnings.simplefilter("ignore", RefinementWarning)
            return self._refiner.refine(bytes(image) if isinstance(image, (bytearray, memoryview)) else image, fov=self._fov)


def _either(columns: Mapping[str, Any], one: str, other: str, remedy: str) -> str:
    """The first of two columns that is there."""
    for column in (one, other):
        if column in columns:
            return column
    raise Error(f"the photographs have no column {one} or {other}, only {', '.join(columns) or 'none'}; {remedy}")


def _threads() -> int | None:
    """The CPUs of this actor; all of the machine's outside of one."""
    try:
        import ray
    except ImportError:
        return None
    if not ray.is_initialized():
        return None
    context: Any = ray.get_runtime_context()
    return max(1, int(context.get_assigned_resources().get("CPU", 1)))


def _untimed(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _untimed(part) for key, part in value.items() if not key.endswith("seconds")}
    return [_untimed(part) for part in value] if isinstance(value, list) else value


def _columns(result: Result | None) -> dict[str, Any]:
    if result is None:
        nothing = {"height": 0, "width": 0, "unit": "", "median_depth": np.nan, "median_sigma": np.nan, "run": ""}
        return {"depth": b"", "sigma": b"", **nothing}
    known = np.isfinite(result.sigma)
    median = [float(np.median(values[known])) if known.any() else np.nan for values in (result.depth, result.sigma)]
    # Times and memory differ from run to run.
    record = _untimed(result.run)
    return {
        "depth": _npy(result.depth),
        "sigma": _npy(result.sigma),
        "height": result.depth.shape[0],
        "width": result.depth.shape[1],
        "unit": result.unit,
        "median_depth": median[0],
        "median_sigma": median[1],
        "run": json.dumps(record),
    }


def _ends(result: Result | None) -> dict[str, bytes]:
    """The interval's files; empty where there is no result."""
    ends = {"lower": None, "upper": None} if result is None else {"lower": result.lower, "upper": result.upper}
    return {name: b"" if values is None else _npy(values) for name, values in ends.items()}


def _npy(values: NDArray[np.float32]) -> bytes:
    """The bytes of the program's file."""
    from . import _mdenerf as native

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "map.npy")
        native.save_npy(path, values)
        return Path(path).read_bytes()


def _column(values: list[Any]) -> NDArray[Any]:
    if isinstance(values[0], (bytes, str)):
        column = np.empty(len(values), dtype=object)
        column[:] = values
        return column
    return np.array(values)


def read_map(data: bytes) -> NDArray[np.float32]:
    """The map ``float32 [height, width]`` of a row's ``depth``, ``sigma``, ``lower`` or ``upper``."""
    values: NDArray[np.float32] = np.load(io.BytesIO(data), allow_pickle=False)
    return values


def pending(folder: str | os.PathLike[str], filesystem: Any = None) -> Callable[[dict[str, Any]], bool]:
    """A filter of what earlier jobs have not done: ``photographs.filter(mdenerf.ray.pending("out"))``.

    Files that can't be read, as a job that was killed leaves them, are skipped with a :class:`RuntimeWarning` that names them.

    Parameters
    ----------
    folder : path
        Where earlier jobs wrote Parquet, files ``*.parquet``; it need not exist.
    filesystem : pyarrow.fs.FileSystem, optional
        Where that is.

    Returns
    -------
    callable
        True for a row whose ``name`` or ``path`` has no row with the status ``done`` there.
    """
    import pyarrow.fs

    place = os.fspath(folder)
    if filesystem is None:
        filesystem, place = pyarrow.fs.FileSystem.from_uri(place) if "://" in place else (pyarrow.fs.LocalFileSystem(), place)
    entries = filesystem.get_file_info(pyarrow.fs.FileSelector(place, recursive=True, allow_not_found=True))
    files = sorted(entry.path for entry in entries if entry.is_file and entry.path.endswith(".parquet"))
    with ThreadPoolExecutor(_READERS) as readers:
        found = list(readers.map(lambda path: _done(path, filesystem), files))
    for path, names in zip(files, found, strict=True):
        if names is None:
            message = f"{path}: can't be read, so its photographs are refined again; remove it once no job writes to it"
            warnings.warn(message, RuntimeWarning, stacklevel=2)
    done = frozenset[str]().union(*(names for names in found if names is not None))

    def is_pending(row: dict[str, Any]) -> bool:
        return str(row[_either(row, "name", "path", "give include_paths=True to the function that reads them")]) not in done

    return is_pending


def _done(path: str, filesystem: Any) -> frozenset[str] | None:
    """The names of a file's rows that are done; nothing for one that can't be read, or has no such rows."""
    import pyarrow
    import pyarrow.parquet

    try:
        with filesystem.open_input_file(path) as file:
            table = pyarrow.parquet.ParquetFile(file).read(columns=["name", "status"])
        rows = zip(table["name"].to_pylist(), table["status"].to_pylist(), strict=True)
    except (pyarrow.ArrowException, OSError, KeyError):
        return None
    return frozenset(name for name, status in rows if status == "done")


def webdataset(row: dict[str, Any]) -> dict[str, Any]:
    """A row for WebDataset: ``refined.map(mdenerf.ray.webdataset).write_webdataset("shards", encoder=None)``.

    The sample's key is the name without its extension, other dots as underscores; its files are ``depth.npy``, ``sigma.npy``,
    with an interval ``lower.npy`` and ``upper.npy``, and ``json``, the other columns.
    """
    maps = {f"{name}.npy": row[name] for name in ("depth", "sigma", "lower", "upper") if name in row}
    rest = {key: value for key, value in row.items() if f"{key}.npy" not in maps and key != "run"}
    rest = {key: value.item() if isinstance(value, np.generic) else value for key, value in rest.items()}
    run = json.loads(row["run"]) if row["run"] else None
    return {
        "__key__": str(PurePosixPath(str(row["name"])).with_suffix("")).strip("/").replace(".", "_"),
        **maps,
        "json": json.dumps({**rest, "run": run}).encode(),
    }
