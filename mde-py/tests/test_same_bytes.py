"""The package gives the program's bytes."""

import json
import re
import subprocess
import time

import numpy as np
import pytest
from PIL import Image

import mdenerf
from mdenerf import _mdenerf as native

from conftest import NETWORK

#: Short fits; the tests are of equality.
QUICK = "nerf.train = { steps = 40, rays = 64 }\nviews.count = 3\nnovel.count = 2\n"


#: All that `mde refine --export` writes.
FORMATS = ["ply", "glb", "exr", "colmap", "transforms", "sigma"]


def same_files(saved, folder):
    """Whether a saved result has the files of the program's folder, byte for byte but for the record and the report. The program's
    marker, by which a run continues, is its own."""
    files = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file() and path.name != "finished.json"}
    assert {path.relative_to(saved) for path in saved.rglob("*") if path.is_file()} == files
    for name in files:
        if name.name not in ("run.json", "report.html"):
            # The page of a capture has the seconds of each photograph, with one decimal.
            seconds = rb">[0-9]+\.[0-9]</td" if name.name == "index.html" else rb"$^"
            ours, theirs = (re.sub(seconds, b"", (place / name).read_bytes()) for place in (saved, folder))
            assert ours == theirs, name


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
    result = mdenerf.refine(photo, prior_depth=depth, preset=preset, config=QUICK, seed=3)
    same(result, tmp_path / "out")
    by_path = mdenerf.refine(str(photo_file), prior_depth=tmp_path / "depth.npy", preset=preset, config=tmp_path / "quick.toml", seed=3)
    same(by_path, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["training"] == record["training"]
    if preset == "paper":
        other = mdenerf.refine(photo, prior_depth=depth, preset=preset, config=QUICK, seed=4)
        assert len(record["training"]) > 0 and other.run["training"] != record["training"]


def test_a_network(photo, photo_file, network, arguments, mde, tmp_path):
    mde("refine", photo_file, *arguments, "-o", tmp_path / "out")
    result = mdenerf.refine(photo, **network)
    same(result, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["augmentation"]["predictions"] == record["augmentation"]["predictions"] > 1
    assert result.run["prior"] == {**record["prior"], "source": network["prior_model"]}
    assert result.config == (tmp_path / "out" / "config.toml").read_text()
    assert mdenerf.Refiner(**network).runtime == "tract"


def test_a_larger_photograph(depth, network, arguments, mde, tmp_path):
    """Refined at a smaller size, and brought back."""
    image = np.random.default_rng(0).integers(0, 255, (60, 90, 3), dtype=np.uint8)
    (tmp_path / "large.png").write_bytes(native.encode_png(image))
    mde("refine", tmp_path / "large.png", *arguments, "--work-size", 0.002, "--fov", 70, "-o", tmp_path / "out")
    result = mdenerf.refine(image, **network, work_size=0.002, fov=70)
    same(result, tmp_path / "out")
    same_files(result.save(tmp_path / "saved"), tmp_path / "out")
    mde("refine", tmp_path / "large.png", *arguments, "--max-size", 48, "-o", tmp_path / "small")
    small = mdenerf.refine(tmp_path / "large.png", **network, max_size=48)
    same(small, tmp_path / "small")
    # Bytes do not hold this photograph: its preview and its colours are of the resized one.
    same_files(small.save(tmp_path / "saved-small"), tmp_path / "small")
    assert small.depth.shape == (32, 48)
    assert small.camera.width == 48 and any("resized" in text for text in small.run["warnings"])


@pytest.fixture(scope="session")
def calibration(mde, tmp_path_factory):
    """Of other settings than those of the tests, of which both warn."""
    folder = tmp_path_factory.mktemp("calibration") / "learned"
    mde("calibrate", "--dataset", "rooms", "--size", "64x48", "--limit", 3, "--simulated", "model", "-o", folder)
    return folder / "calibration.toml"


@pytest.mark.parametrize("calibrated", [False, True])
def test_an_interval_and_the_exports(photo_file, network, arguments, mde, tmp_path, calibration, calibrated):
    options = {"interval": 0.8, **({"calibration": calibration} if calibrated else {})}
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    mde("refine", photo_file, *arguments, *words, "--export", ",".join(FORMATS), "-o", tmp_path / "out")
    with pytest.warns(mdenerf.RefinementWarning, match="calibration .*other" if calibrated else "interval: no calibration"):
        result = mdenerf.refine(photo_file, **network, **options)
    same(result, tmp_path / "out")
    same_files(result.save(tmp_path / "saved", export=FORMATS), tmp_path / "out")
    assert (result.lower < result.depth).all() and (result.depth < result.upper).all()
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert result.run["error_bar"] == record["error_bar"]
    assert (result.run["error_bar"]["factor"] != 1) == calibrated
    plain = mdenerf.refine(photo_file, **network)
    assert plain.lower is None and plain.upper is None


def test_known_depths_give_the_scale(photo, photo_file, network, arguments, mde, tmp_path):
    before = mdenerf.refine(photo, **network).depth
    places = [(5, 6, 1.02, 0.01), (40, 30, 0.99, 0.02), (50, 8, 1.01, 0), (20, 40, 0.97, 0.05), (33, 20, 1.0, 0)]
    known = np.array([[x, y, 1.5 * noise * before[y, x], sigma] for x, y, noise, sigma in places])
    table = tmp_path / "known.csv"
    table.write_text("x,y,depth,sigma\n" + "".join(",".join(f"{value!r}" for value in row) + "\n" for row in known.tolist()))
    mde("refine", photo_file, *arguments, "--scale-from", table, "--export", "sigma", "-o", tmp_path / "out")
    by_file = mdenerf.refine(photo_file, **network, scale_from=table)
    same_files(by_file.save(tmp_path / "saved", export="sigma"), tmp_path / "out")
    by_array = mdenerf.refine(photo, **network, scale_from=known)
    same(by_array, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert by_file.run["scale"] == record["scale"] and by_array.run["scale"] == {**record["scale"], "from": "array"}
    assert by_array.unit == record["unit"] == "m" and "scale" in by_array.components
    without_sigma = mdenerf.refine(photo, **network, scale_from=known[:, :3].tolist())
    assert without_sigma.unit == "m" and without_sigma.depth.tobytes() != by_array.depth.tobytes()


def test_a_colmap_model_gives_the_scale(photo_file, depth, mde, tmp_path):
    native.save_npy(str(tmp_path / "depth.npy"), depth)
    prior = ["--prior-depth", tmp_path / "depth.npy", "--preset", "fast"]
    mde("refine", photo_file, *prior, "--export", "colmap", "-o", tmp_path / "first")
    model, image = tmp_path / "first" / "colmap", tmp_path / "image.png"
    image.write_bytes(photo_file.read_bytes())
    mde("refine", image, *prior, "--scale-from", model, "-o", tmp_path / "out")
    result = mdenerf.refine(image, prior_depth=tmp_path / "depth.npy", preset="fast", scale_from=model)
    same_files(result.save(tmp_path / "saved"), tmp_path / "out")
    assert result.unit == "capture"


def test_a_depth_of_another_size(photo, photo_file, mde, tmp_path):
    depth = np.linspace(1.0, 3.0, 96 * 128, dtype=np.float32).reshape(96, 128)
    native.save_npy(str(tmp_path / "depth.npy"), depth)
    mde("refine", photo_file, "--prior-depth", tmp_path / "depth.npy", "--preset", "fast", "-o", tmp_path / "out")
    result = mdenerf.refine(photo, prior_depth=depth, preset="fast")
    same(result, tmp_path / "out")
    assert any("resized from 128x96 to 64x48" in text for text in result.run["warnings"])


def test_a_depth_in_a_png(photo_file, depth, mde, tmp_path):
    """With a scale that its metadata do not have."""
    Image.fromarray(np.uint16(2000 * depth)).save(tmp_path / "depth.png")
    given = ["--prior-depth", tmp_path / "depth.png", "--png-scale", 2000, "--preset", "fast"]
    mde("refine", photo_file, *given, "-o", tmp_path / "out")
    result = mdenerf.refine(photo_file, prior_depth=tmp_path / "depth.png", png_scale=2000, preset="fast")
    same(result, tmp_path / "out")
    assert abs(np.median(result.depth) / np.median(depth) - 1) < 0.1


def test_intrinsics(photo_file, network, arguments, mde, tmp_path):
    (tmp_path / "K.txt").write_text("70 0 33\n0 71 25.5\n0 0 1\n")
    mde("refine", photo_file, *arguments, "--intrinsics", tmp_path / "K.txt", "--export", "ply", "-o", tmp_path / "out")
    matrix = np.array([[70, 0, 33], [0, 71, 25.5], [0, 0, 1]])
    for intrinsics in (matrix, {"fx": 70, "fy": 71, "cx": 33, "cy": 25.5}):
        result = mdenerf.refine(photo_file, **network, intrinsics=intrinsics)
        assert (result.camera.fy, result.camera.cx, result.camera.cy) == (71, 33, 25.5)
    by_file = mdenerf.refine(photo_file, **network, intrinsics=tmp_path / "K.txt")
    same_files(by_file.save(tmp_path / "saved", export="ply"), tmp_path / "out")
    assert by_file.run["camera"] == json.loads((tmp_path / "out" / "run.json").read_text())["camera"]


def test_settings_with_arguments_of_their_own(photo, photo_file, network, arguments, mde, tmp_path):
    given = ["--predictions", 2, "--depth-range", "0.5,20", "--no-nerf"]
    mde("refine", photo_file, *arguments, *given, "-o", tmp_path / "out")
    result = mdenerf.refine(photo, **network, predictions=2, depth_range=(0.5, 20), no_nerf=True)
    same(result, tmp_path / "out")
    assert result.config == (tmp_path / "out" / "config.toml").read_text()
    assert mdenerf.refine(photo, **network, predictions="auto").run["augmentation"]["predictions"] > 2


def test_the_field_is_kept(photo, photo_file, depth, mde, tmp_path):
    native.save_npy(str(tmp_path / "depth.npy"), depth)
    (tmp_path / "quick.toml").write_text(QUICK)
    prior = ["--prior-depth", tmp_path / "depth.npy", "--preset", "paper", "--config", tmp_path / "quick.toml"]
    mde("refine", photo_file, *prior, "--export", "field", "-o", tmp_path / "out")
    result = mdenerf.refine(photo_file, prior_depth=tmp_path / "depth.npy", preset="paper", config=QUICK, keep_field=True)
    same_files(result.save(tmp_path / "saved"), tmp_path / "out")
    assert result.field == (tmp_path / "out" / "field.safetensors").read_bytes()
    mde("render", "--field", tmp_path / "saved" / "field.safetensors", "--size", "64x48", "--fov", 60, "-o", tmp_path / "view")
    assert mdenerf.refine(photo, prior_depth=depth, preset="paper", config=QUICK).field is None
    with pytest.warns(mdenerf.RefinementWarning, match="keep_field: no field was fitted"):
        assert mdenerf.refine(photo, prior_depth=depth, preset="fast", keep_field=True).field is None


@pytest.mark.parametrize(("posed", "prior"), [(False, True), (True, True), (True, False)])
def test_several_photographs(network, arguments, mde, tmp_path, demo, posed, prior):
    network, arguments = (network, arguments) if prior else ({}, [])
    quick = "nerf.train.steps = 60\nnerf.train.rays = 64\nnerf.field.finest = 64\n"
    (tmp_path / "quick.toml").write_text(quick)
    photographs = sorted((demo / "photographs").iterdir())
    assert len(photographs) > 2
    views = [demo / "transforms.json"] if posed else photographs[1:]
    mde("refine", photographs[0], "--views", *views, *arguments, "--config", tmp_path / "quick.toml", "--export", "colmap", "-o", tmp_path / "out")
    given = str(demo / "transforms.json") if posed else photographs[1:]
    result = mdenerf.refine(photographs[0], views=given, config=quick, **network)
    same(result, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    same_files(result.save(tmp_path / "saved", export="colmap"), tmp_path / "out")
    assert len(list((tmp_path / "out" / "colmap" / "images").iterdir())) > 1
    assert result.run["preset"] == "multi-view"
    assert result.run["capture"]["photographs"] == record["capture"]["photographs"]
    assert result.run["camera"]["fx"] == record["camera"]["fx"]


@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("capture", ["folder", "list", "transforms.json"])
def test_every_photograph(network, arguments, mde, tmp_path, demo, capture, prior):
    network, arguments = (network, arguments) if prior else ({}, [])
    quick = "nerf.train.steps = 40\nnerf.train.rays = 64\nnerf.field.finest = 64\n"
    (tmp_path / "quick.toml").write_text(quick)
    posed = capture == "transforms.json"
    folder = demo / capture
    if not posed:
        folder = tmp_path / "room"
        folder.mkdir()
        for path in sorted((demo / "photographs").iterdir())[:4]:
            (folder / path.name).write_bytes(path.read_bytes())
    unit = ["--unit", "capture"] if posed else []
    options = [*arguments, "--config", tmp_path / "quick.toml", *unit, "--export", "ply"]
    mde("dense", folder, *options, "-o", tmp_path / "out")
    calls = []
    scene = mdenerf.dense(
        sorted(folder.iterdir()) if capture == "list" else folder,
        unit="poses" if posed else "prior",
        config=quick,
        progress=lambda *call: calls.append(call),
        **network,
    )
    count = len(scene)
    assert count == len(scene.names) == len(scene.poses) == (count if posed else 4) and count > 2
    assert [call for call in calls if call[0] == "photograph"] == [("photograph", done + 1, count) for done in range(count)]
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert scene.run["command"] == record["command"] == "dense" and (capture == "list" or scene.run["input"] == record["input"])
    keys = ("photograph", "folder", "reason", "verified", "sigma", "scale")
    for name, result, mine, theirs in zip(scene.names, scene, scene.run["photographs"], record["photographs"], strict=True):
        same(result, tmp_path / "out" / theirs["folder"])
        assert {key: mine[key] for key in keys} == {key: theirs[key] for key in keys} and mine["photograph"] == name
    saved = scene.save(tmp_path / "saved", export="ply")
    same_files(saved, tmp_path / "out")
    assert json.loads((saved / "run.json").read_text())["points"] == record["points"] > 0
    assert scene.unit == record["unit"] and sum(pose is not None for pose in scene.poses) > 1
    frames = json.loads((saved / "transforms.json").read_text())["frames"]
    placed = [pose for pose in scene.poses if pose is not None]
    for frame, pose in zip(frames, placed, strict=True):
        to_world = np.linalg.inv(pose) @ np.diag([1.0, -1.0, -1.0, 1.0])
        np.testing.assert_allclose(np.array(frame["transform_matrix"]), to_world, atol=1e-9)
    plain = scene.save(tmp_path / "plain", report=False)
    assert not (plain / "index.html").exists() and (plain / "cloud.ply").is_file()
    with pytest.raises(mdenerf.Error, match="the folder exists"):
        scene.save(saved)


def test_every_record_is_of_its_photograph(demo):
    """Its own camera, warnings and seconds, whatever came before it."""
    images = [Image.open(path).convert("RGB") for path in sorted((demo / "photographs").iterdir())[:3]]
    images[1].getexif()[0xA405] = 30
    # Of another scene.
    noise = np.random.default_rng(1).integers(0, 255, (18, 24, 3), dtype=np.uint8)
    images.insert(1, Image.fromarray(np.kron(noise, np.ones((8, 8, 1), np.uint8))))
    quick = {"nerf": {"train": {"steps": 20, "rays": 64}, "field": {"finest": 64}}}
    begun = time.monotonic()
    scene = mdenerf.dense(images, lambda rgb: 2 + rgb[..., 0], config=quick, predictions=1)
    seconds = time.monotonic() - begun
    assert [one.run["camera"]["source"] == {"exif": 30.0} for one in scene] == [False, False, True, False]
    alone = [row["reason"] is not None for row in scene.run["photographs"]]
    assert alone[1] and not all(alone)
    told = [any("only the reference photograph" in text for text in one.run["warnings"]) for one in scene]
    assert told == alone and any("only the reference photograph" in text for text in scene.run["warnings"])
    assert sum(one.run["total_seconds"] for one in scene) < seconds


def test_what_is_no_photograph_of_the_place_is_left_out(photo_file, demo, tmp_path):
    """A file that can't be read, the same picture again, and, without a network, a photograph of another place."""
    folder = tmp_path / "room"
    folder.mkdir()
    for path in sorted((demo / "photographs").iterdir())[:3]:
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "again.png").write_bytes((folder / "0.png").read_bytes())
    (folder / "other.png").write_bytes(photo_file.read_bytes())
    (folder / "torn.png").write_bytes(b"nothing")
    command = [str(mdenerf.program()), "dense", str(folder), "--no-nerf", "-o", str(tmp_path / "out")]
    assert subprocess.run(command, capture_output=True).returncode != 0, "not all were refined"
    with pytest.warns(mdenerf.RefinementWarning) as caught:
        scene = mdenerf.dense(folder, no_nerf=True)
    told = [str(warning.message) for warning in caught]
    for text in ("again.png", "other.png is left out", "torn.png"):
        assert any(text in one for one in told), text
    assert scene.names == ["0.png", "1.png", "2.png"]
    saved = scene.save(tmp_path / "saved")
    for place in (saved, tmp_path / "out"):
        # The reasons name an argument, not an option.
        (place / "index.html").unlink()
    same_files(saved, tmp_path / "out")
    rows = [json.loads((place / "run.json").read_text())["photographs"] for place in (tmp_path / "out", tmp_path / "saved")]
    assert [row["folder"] for row in rows[0]] == [row["folder"] for row in rows[1]]
    assert [row["error"] is None for row in rows[0]] == [row["error"] is None for row in rows[1]]
    for names, text in [
        ([], "give two or more"),
        (["0.png"], "give two or more"),
        (["0.png", "torn.png"], "torn.png: no readable image"),
        (["0.png", "other.png"], "no photograph could be refined"),
        (["0.png", "again.png"], "no photograph could be refined"),
    ]:
        with pytest.raises(mdenerf.Error, match=text):
            mdenerf.dense([folder / name for name in names])


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
