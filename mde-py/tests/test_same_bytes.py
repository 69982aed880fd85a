"""The package gives the program's bytes."""

import json

import numpy as np
import pytest

import mdenerf
from mdenerf import _mdenerf as native

from conftest import NETWORK

#: Short fits; the tests are of equality.
QUICK = "nerf.train = { steps = 40, rays = 64 }\nviews.count = 3\nnovel.count = 2\n"


def same(result, folder):
    """Whether the maps are those of the program's folder, bit for bit."""
    for name, values in (("depth", result.depth), ("sigma", result.sigma), ("prior", result.prior)):
        expected = np.load(folder / f"{name}.npy")
        assert expected.dtype == values.dtype == np.float32
        assert expected.shape == values.shape
        assert expected.tobytes() == values.tobytes(), f"{name} differs by {np.abs(expected - values).max()}"


@pytest.mark.parametrize("preset", ["default", "paper", "fast"])
def test_a_depth_map(photo, photo_file, depth, mde, tmp_path, preset):
    native.save_npy(str(tmp_path / "depth.npy"), depth)
    (tmp_path / "quick.toml").write_text(QUICK)
    settings = ["--preset", preset, "--config", tmp_path / "quick.toml", "--seed", 3]
    mde("refine", photo_file, "--prior-depth", tmp_path / "depth.npy", *settings, "-o", tmp_path / "out")
    result = mdenerf.refine(photo, depth=depth, preset=preset, config=QUICK, seed=3)
    same(result, tmp_path / "out")
    by_path = mdenerf.refine(str(photo_file), depth=tmp_path / "depth.npy", preset=preset, config=tmp_path / "quick.toml", seed=3)
    same(by_path, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["training"] == record["training"]
    if preset != "fast":
        other = mdenerf.refine(photo, depth=depth, preset=preset, config=QUICK, seed=4)
        assert len(record["training"]) > 0 and other.run["training"] != record["training"]


def test_a_network(photo, photo_file, network, arguments, mde, tmp_path):
    mde("refine", photo_file, *arguments, "-o", tmp_path / "out")
    result = mdenerf.refine(photo, **network)
    same(result, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["augmentation"]["predictions"] == record["augmentation"]["predictions"] > 1
    assert result.run["prior"] == {**record["prior"], "source": network["model"]}
    assert result.config == (tmp_path / "out" / "config.toml").read_text()
    prior = native.Prior.network(network["model"], (None, (32, 32), "disparity"), "tract", None, None)
    assert prior.runtime == "tract" and prior.kind == "disparity"


def test_a_larger_photograph(depth, network, arguments, mde, tmp_path):
    """Refined at a smaller size, and brought back."""
    image = np.random.default_rng(0).integers(0, 255, (60, 90, 3), dtype=np.uint8)
    native.save_rgb(str(tmp_path / "large.png"), image)
    mde("refine", tmp_path / "large.png", *arguments, "--work-size", 0.002, "--fov", 70, "-o", tmp_path / "out")
    result = mdenerf.refine(image, **network, work_size=0.002, fov=70)
    same(result, tmp_path / "out")
    mde("refine", tmp_path / "large.png", *arguments, "--max-size", 48, "-o", tmp_path / "small")
    small = mdenerf.refine(tmp_path / "large.png", **network, max_size=48)
    same(small, tmp_path / "small")
    assert small.depth.shape == (32, 48)
    assert small.camera.width == 48 and any("resized" in text for text in small.run["warnings"])


def test_a_depth_of_another_size(photo, photo_file, mde, tmp_path):
    depth = np.linspace(1.0, 3.0, 96 * 128, dtype=np.float32).reshape(96, 128)
    native.save_npy(str(tmp_path / "depth.npy"), depth)
    mde("refine", photo_file, "--prior-depth", tmp_path / "depth.npy", "--preset", "fast", "-o", tmp_path / "out")
    result = mdenerf.refine(photo, depth=depth, preset="fast")
    same(result, tmp_path / "out")
    assert any("resized from 128x96 to 64x48" in text for text in result.run["warnings"])


@pytest.mark.parametrize("posed", [False, True])
def test_several_photographs(network, arguments, mde, tmp_path, demo, posed):
    quick = "nerf.train.steps = 60\nnerf.train.rays = 64\nnerf.field.finest = 64\n"
    (tmp_path / "quick.toml").write_text(quick)
    photographs = sorted((demo / "photographs").iterdir())
    assert len(photographs) > 2
    views = [demo / "transforms.json"] if posed else photographs[1:]
    mde("refine", photographs[0], "--views", *views, *arguments, "--config", tmp_path / "quick.toml", "-o", tmp_path / "out")
    given = str(demo / "transforms.json") if posed else photographs[1:]
    result = mdenerf.refine(photographs[0], views=given, config=quick, **network)
    same(result, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["preset"] == "multi-view"
    assert result.run["capture"]["photographs"] == record["capture"]["photographs"]
    assert result.run["camera"]["fx"] == record["camera"]["fx"]


@pytest.mark.parametrize(
    ("name", "camera", "unit", "source"),
    [
        ("metric3d", {"fov": 60.0}, "m", {"field-of-view": 60.0}),
        ("metric3d", {}, "unscaled", {"assumed": 60.0}),
        ("unidepth", {}, "m", "network"),
        ("unidepth", {"fov": 60.0}, "m", {"field-of-view": 60.0}),
    ],
)
def test_a_network_with_a_camera(photo, photo_file, mde, tmp_path, name, camera, unit, source):
    """Metres by the focal length, and a network's own camera."""
    model = NETWORK.with_name(f"{name}.onnx")
    fov = [word for key, value in camera.items() for word in (f"--{key}", value)]
    mde("refine", photo_file, "--prior-model", model, *fov, "--preset", "fast", "-o", tmp_path / "out")
    result = mdenerf.refine(photo, str(model), **camera, preset="fast", runtime="tract")
    same(result, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.unit == record["unit"] == unit
    assert result.run["camera"] == record["camera"] and record["camera"]["source"] == source
