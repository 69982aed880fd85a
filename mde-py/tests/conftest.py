"""Inputs that the tests share."""

import json
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import mdenerf
from mdenerf import _mdenerf as native

#: A network of a few kilobytes whose input is 32x32 and whose output is disparity.
NETWORK = Path(__file__).parents[2] / "mde-prior" / "tests" / "fixtures" / "midas_small.onnx"


@pytest.fixture(scope="session")
def profile(tmp_path_factory) -> Path:
    """The file of the network's input and output."""
    path = tmp_path_factory.mktemp("profile") / "midas.toml"
    path.write_text("width = 32\nheight = 32\noutput = 'disparity'\n")
    return path


@pytest.fixture(scope="session")
def network(profile) -> dict:
    """Arguments of a network in an ONNX file."""
    return {"prior_model": str(NETWORK), "model_profile": profile, "runtime": "tract"}


@pytest.fixture(scope="session")
def arguments(profile) -> list:
    """The same for the program."""
    return ["--prior-model", str(NETWORK), "--model-profile", profile]


def scene(height: int = 48, width: int = 64, shift: float = 0.0) -> tuple:
    """A photograph ``uint8`` of a textured wall with a nearer square, and its depth in metres."""
    rows, columns = np.indices((height, width)).astype(np.float64)
    near = (abs(rows - height / 2) < height / 4) & (abs(columns - width / 2) < width / 4)
    depth = np.where(near, 2.0, 4.0 + 0.01 * columns).astype(np.float32)
    texture = np.sin(0.9 * (columns + shift)) + np.cos(0.7 * rows) + np.where(near, 0.8, 0.0)
    image = np.stack([texture, np.roll(texture, 3, axis=0), -texture], axis=-1)
    return np.uint8(np.clip(127 + 45 * image, 0, 255)), depth


@pytest.fixture(scope="session")
def photo() -> np.ndarray:
    return scene()[0]


@pytest.fixture(scope="session")
def depth() -> np.ndarray:
    return scene()[1]


@pytest.fixture(scope="session")
def photo_file(photo, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("photo") / "photo.png"
    path.write_bytes(native.encode_png(photo))
    return path


@pytest.fixture(scope="session")
def mde():
    """Runs the program of the package."""

    def run(*words) -> subprocess.CompletedProcess:
        command = [str(mdenerf.program()), *map(str, words)]
        return subprocess.run(command, check=True, capture_output=True, text=True)

    return run


@pytest.fixture(scope="session")
def ticker():
    """The longest time that another thread waits during a call, as a share of the call's: 1 where the call keeps the interpreter."""

    def share(call) -> float:
        ticks, stop = [], threading.Event()

        def tick():
            while not stop.is_set():
                ticks.append(time.monotonic())
                time.sleep(0.001)

        thread = threading.Thread(target=tick)
        thread.start()
        begun = time.monotonic()
        call()
        ended = time.monotonic()
        stop.set()
        thread.join()
        assert ended - begun > 0.05, "too short to tell"
        within = [begun, *(moment for moment in ticks if begun < moment < ended), ended]
        return float(np.diff(within).max() / (ended - begun))

    # The machine may have been busy.
    return lambda call: min(share(call) for _ in range(3))


@pytest.fixture(scope="session")
def demo(mde, tmp_path_factory) -> Path:
    """A folder with ``photographs`` of a room and their poses, ``transforms.json``."""
    folder = tmp_path_factory.mktemp("room")
    settings = folder / "quick.toml"
    settings.write_text("nerf.train.steps = 60\nnerf.train.rays = 256\nnerf.field.finest = 64\n")
    mde("demo", "--size", "192x144", "--config", settings, "-o", folder / "demo")
    record = json.loads((folder / "demo" / "run.json").read_text())
    photographs = record["capture"]["photographs"]
    assert record["capture"].get("fallback") is None and sum(one["pose"] is not None for one in photographs) > 2
    frames = []
    for one in photographs:
        if one["pose"] is not None:
            to_world = np.linalg.inv(np.array(one["pose"])) @ np.diag([1.0, -1.0, -1.0, 1.0])
            frames.append({"file_path": f"photographs/{one['name']}", "transform_matrix": to_world.tolist()})
    camera = record["camera"]
    lens = {"fl_x": camera["fx"], "fl_y": camera["fy"], "cx": camera["cx"], "cy": camera["cy"], "w": 192, "h": 144}
    lens["pixel_centres"] = "integers"
    (folder / "demo" / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    return folder / "demo"
