"""Ray Data on a cluster of several node processes, one of which is killed on the way."""

import json
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import mdenerf
import mdenerf.ray
from mdenerf import _mdenerf as native

ray = pytest.importorskip("ray")
pytest.importorskip("pyarrow")

PHOTOGRAPHS = 12


# The workers do not import the tests.
ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Photographs, and a file that is none."""
    place = tmp_path_factory.mktemp("photographs")
    for index in range(PHOTOGRAPHS):
        pixels = np.random.default_rng(index).integers(0, 255, (40 + index, 48, 3), dtype=np.uint8)
        (place / f"{index:02}.png").write_bytes(native.encode_png(pixels))
    (place / "broken.png").write_bytes(b"no photograph")
    return place


@pytest.fixture(scope="module")
def cluster():
    """A head without work, and nodes."""
    from ray.cluster_utils import Cluster

    small = {"object_store_memory": 100 * 2**20}
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "resources": {"head": 1}, **small})
    nodes = [made.add_node(num_cpus=2, resources={"work": 2}, **small) for _ in range(3)]
    made.wait_for_nodes()
    ray.init(address=made.address, log_to_driver=False)
    ray.data.DataContext.get_current().enable_progress_bars = False
    yield made, nodes
    ray.shutdown()
    made.shutdown()


class Slow(mdenerf.ray.Refine):
    """Slow enough to be killed on the way; it says where it works."""

    def __init__(self, log, **arguments):
        super().__init__(**arguments)
        self._log = Path(log)

    def __call__(self, batch):
        (self._log / ray.get_runtime_context().get_node_id()).touch()
        time.sleep(0.7)
        return super().__call__(batch)


@pytest.fixture
def refine(network):
    """An actor without a cluster."""
    return mdenerf.ray.Refine(**network, preset="fast")


def objects(*values) -> np.ndarray:
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def test_no_photograph_ends_the_job(refine, folder, monkeypatch):
    file = (folder / "00.png").read_bytes()
    batch = {"path": objects("a", "b"), "bytes": objects(file, file)}
    calls = []
    original = refine._refiner.refine

    def fails_once(image, **settings):
        calls.append(image)
        if len(calls) == 1:
            raise MemoryError("no room\nfor 3 GiB")
        return original(image, **settings)

    monkeypatch.setattr(refine._refiner, "refine", fails_once)
    rows = refine(batch)
    assert list(rows["status"]) == ["failed", "done"]
    assert rows["error"][0] == "MemoryError: no room for 3 GiB" and rows["depth"][0] == b""


def test_a_batch_without_names_is_told(refine, folder):
    file = (folder / "00.png").read_bytes()
    with pytest.raises(mdenerf.Error, match="no column name or path, only bytes; give include_paths=True"):
        refine({"bytes": objects(file)})
    with pytest.raises(mdenerf.Error, match="no column bytes or image, only path; read them with"):
        refine({"path": objects("a")})
    with pytest.raises(mdenerf.Error, match="include_paths=True"):
        mdenerf.ray.pending("absent")({"bytes": file})


def test_what_a_killed_job_leaves_is_skipped(tmp_path):
    import pyarrow
    import pyarrow.parquet

    def is_pending():
        chosen = mdenerf.ray.pending(tmp_path / "out")
        return [chosen({"path": name}) for name in ("a", "b", "c")]

    assert is_pending() == [True] * 3
    (tmp_path / "out" / "part").mkdir(parents=True)
    assert is_pending() == [True] * 3
    table = pyarrow.table({"name": ["a", "b"], "status": ["done", "failed"], "seconds": [1.0, 2.0]})
    pyarrow.parquet.write_table(table, tmp_path / "out" / "part" / "0.parquet")
    (tmp_path / "out" / "notes.txt").write_text("not Parquet")
    assert is_pending() == [False, True, True]
    whole = (tmp_path / "out" / "part" / "0.parquet").read_bytes()
    pyarrow.parquet.write_table(pyarrow.table({"other": [1]}), tmp_path / "out" / "other.parquet")
    for length in (0, 3, len(whole) // 2, len(whole) - 1):
        (tmp_path / "out" / "torn.parquet").write_bytes(whole[:length])
        with pytest.warns(RuntimeWarning, match="parquet: can't be read, so its photographs are refined again") as told:
            assert is_pending() == [False, True, True]
        assert sorted(Path(str(one.message).split(":")[0]).name for one in told) == ["other.parquet", "torn.parquet"]


def test_a_killed_node_changes_no_byte(cluster, folder, network, arguments, mde, tmp_path):
    made, nodes = cluster
    log = tmp_path / "log"
    log.mkdir()
    killed = []

    def kill():
        while not any(log.iterdir()):
            time.sleep(0.05)
        time.sleep(1.0)
        busy = {path.name for path in log.iterdir()}
        node = next(node for node in nodes if node.node_id in busy)
        killed.append(node.node_id)
        made.remove_node(node, allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    photographs = ray.data.read_binary_files(str(folder), include_paths=True)
    settings = {"log": str(log), **network, "preset": "fast", "interval": 0.9}
    refined = photographs.map_batches(
        Slow, fn_constructor_kwargs=settings, batch_size=1, num_cpus=1, resources={"work": 1}, compute=ray.data.ActorPoolStrategy(size=2)
    )
    refined.write_parquet(str(tmp_path / "out"))
    killer.join()
    assert killed and killed[0] not in {node["NodeID"] for node in ray.nodes() if node["Alive"]}
    import pyarrow.dataset

    rows = pyarrow.dataset.dataset(str(tmp_path / "out")).to_table().to_pylist()
    by_name = {Path(row["name"]).name: row for row in rows}
    assert len(rows) == len(by_name) == PHOTOGRAPHS + 1
    broken = by_name.pop("broken.png")
    assert broken["status"] == "failed" and "no readable image" in broken["error"] and broken["depth"] == b"" == broken["upper"]
    for name, row in by_name.items():
        out = tmp_path / "program" / name
        mde("refine", folder / name, *arguments, "--preset", "fast", "--interval", 0.9, "-o", out, "--quiet")
        assert row["status"] == "done" and row["error"] == ""
        for part in ("depth", "sigma", "lower", "upper"):
            assert row[part] == (out / f"{part}.npy").read_bytes(), f"{part} of {name}"
        depth = mdenerf.ray.read_map(row["depth"])
        assert depth.shape == (row["height"], row["width"])
        assert json.loads(row["run"])["threads"] == 1

    # A second job into the same folder has only what failed to do.
    rest = photographs.filter(mdenerf.ray.pending(tmp_path / "out"))
    once = {"fn_constructor_kwargs": {**network, "preset": "fast", "interval": 0.9}, "batch_size": 1}
    pool = ray.data.ActorPoolStrategy(size=1)
    rest.map_batches(mdenerf.ray.Refine, **once, compute=pool).write_parquet(str(tmp_path / "out"))
    rows = pyarrow.dataset.dataset(str(tmp_path / "out")).to_table(columns=["name"]).to_pylist()
    names = sorted(Path(row["name"]).name for row in rows)
    assert names == sorted([*by_name, "broken.png", "broken.png"])


def test_shards_for_webdataset(cluster, folder, network, tmp_path):
    import tarfile

    photographs = ray.data.read_images(str(folder / "00.png"), include_paths=True)
    refined = photographs.map_batches(
        mdenerf.ray.Refine, fn_constructor_kwargs={**network, "preset": "fast", "interval": 0.9}, batch_size=1, num_cpus=1, compute=ray.data.ActorPoolStrategy(size=1)
    )
    refined.map(mdenerf.ray.webdataset).write_webdataset(str(tmp_path / "shards"), encoder=None)
    (shard,) = (tmp_path / "shards").iterdir()
    with tarfile.open(shard) as archive:
        files = {member.name: archive.extractfile(member).read() for member in archive.getmembers()}
    key = str(folder / "00").strip("/")
    maps = ("depth", "sigma", "lower", "upper")
    assert set(files) == {*(f"{key}.{name}.npy" for name in maps), f"{key}.json"}
    expected = mdenerf.refine(folder / "00.png", **network, preset="fast", interval=0.9)
    for name in maps:
        np.testing.assert_array_equal(mdenerf.ray.read_map(files[f"{key}.{name}.npy"]), getattr(expected, name))
    record = json.loads(files[f"{key}.json"])
    assert record["status"] == "done" and record["run"]["unit"] == record["unit"] == "unscaled"
