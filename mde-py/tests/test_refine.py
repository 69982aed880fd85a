"""What the refinement takes, gives and refuses."""

import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import mdenerf

FAST = {"preset": "fast"}


def test_a_callable_is_a_model(photo, depth):
    seen = []

    def model(rgb):
        assert threading.current_thread() is threading.main_thread()
        assert rgb.dtype == np.float32 and rgb.shape[2] == 3 and 0 <= rgb.min() and rgb.max() <= 1
        seen.append(rgb.shape)
        return 2.0 + rgb.mean(axis=2)

    result = mdenerf.refine(photo, model)
    # The photograph, its mirror image and crops.
    assert len(seen) == result.run["augmentation"]["predictions"] > 2
    assert seen[0] == photo.shape
    expected = 2.0 + (photo.astype(np.float32) / 255).mean(axis=2)
    np.testing.assert_allclose(result.prior, expected, rtol=1e-6)
    assert result.depth.shape == result.sigma.shape == photo.shape[:2]
    assert (result.sigma > 0).all() and set(result.components) == {"spread", "disagreement", "common"}
    assert result.run["prior"]["source"].endswith("model")
    one = mdenerf.refine(photo, model, preset="fast", config={"augmentation": {"predictions": 1}})
    assert one.run["augmentation"]["predictions"] == 1


class Tensor:
    """As PyTorch has it: on a device, with a gradient, with a batch."""

    def __init__(self, values, dtype="torch.float32"):
        self.values = values
        self.dtype = dtype

    def detach(self):
        return self

    def cpu(self):
        return self

    def float(self):
        return Tensor(self.values)

    def __array__(self, dtype=None, copy=None):
        if self.dtype == "torch.bfloat16":
            raise TypeError("Got unsupported ScalarType BFloat16")
        return self.values


def test_a_tensor_is_a_prediction(photo):
    result = mdenerf.refine(photo, lambda rgb: Tensor(np.float64(1 + rgb[None, None, ..., 1])), **FAST)
    np.testing.assert_allclose(result.prior, 1 + photo[..., 1].astype(np.float32) / 255, rtol=1e-6)
    half = mdenerf.refine(photo, lambda rgb: Tensor(np.float32(1 + rgb[..., 1]), "torch.bfloat16"), **FAST)
    np.testing.assert_allclose(half.prior, result.prior, rtol=1e-6)


def test_a_tensor_of_pytorch_is_a_prediction(photo):
    torch = pytest.importorskip("torch")

    def model(rgb):
        return (1 + torch.from_numpy(rgb)[None, ..., 1]).to(torch.bfloat16).requires_grad_()

    result = mdenerf.refine(photo, model, **FAST)
    np.testing.assert_allclose(result.prior, 1 + photo[..., 1].astype(np.float32) / 255, rtol=2**-8)


def test_a_session_of_another_framework_is_a_model(photo, network):
    """The same network in a callable and as a file."""
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(network["prior_model"], providers=["CPUExecutionProvider"])
    (entry,) = session.get_inputs()

    def model(rgb):
        pixels = rgb.transpose(2, 0, 1)[None]
        return session.run(None, {entry.name: np.ascontiguousarray(pixels, dtype=np.float32)})[0]

    small = photo[:32, :32].copy()
    settings = {**FAST, "config": {"augmentation": {"predictions": 1}}}
    result = mdenerf.refine(small, model, prior_kind="disparity", **settings)
    file = mdenerf.refine(small, **{**network, **settings})
    np.testing.assert_allclose(result.depth, file.depth, rtol=1e-3)


@pytest.mark.parametrize(
    "image", [lambda a: a, lambda a: a.astype(np.float32) / 255, lambda a: a.astype(np.float64) / 255, lambda a: np.uint16(a) * 257]
)
def test_the_kinds_of_images(photo, depth, image):
    expected = mdenerf.refine(photo, prior_depth=depth, **FAST)
    result = mdenerf.refine(image(photo), prior_depth=depth, **FAST)
    np.testing.assert_array_equal(result.image, photo)
    np.testing.assert_allclose(result.depth, expected.depth, rtol=1e-6)


def test_exchanged_near_and_far_are_told(photo, network, tmp_path):
    rows = {**network, "prior_model": str(Path(network["prior_model"]).with_name("rows.onnx")), "fov": 60}
    told = []
    for kind in ("disparity", "depth"):
        profile = tmp_path / f"{kind}.toml"
        profile.write_text(f"width = 32\nheight = 24\noutput = '{kind}'\n")
        found = mdenerf.refine(photo, **{**rows, **FAST, "model_profile": profile}).run["warnings"]
        told.append(any("near and far are exchanged" in text and "prior_kind disparity" in text for text in found))
    assert told == [False, True]


def test_the_bytes_of_a_file_are_an_image(photo_file, photo, depth):
    result = mdenerf.refine(photo_file.read_bytes(), prior_depth=depth, **FAST)
    assert result.depth.tobytes() == mdenerf.refine(photo, prior_depth=depth, **FAST).depth.tobytes()
    with pytest.raises(mdenerf.Error, match="image: no readable image"):
        mdenerf.refine(b"nothing", prior_depth=depth)


def test_an_image_of_pillow(photo, depth):
    pillow = pytest.importorskip("PIL.Image")
    image = pillow.fromarray(photo)
    tags = image.getexif()
    tags[0x0112] = 6  # Turn by 90 degrees.
    tags.get_ifd(0x8769)[0xA405] = 26
    result = mdenerf.refine(image, prior_depth=np.rot90(depth, 3).copy(), **FAST)
    np.testing.assert_array_equal(result.image, np.rot90(photo, 3))
    assert result.run["camera"]["source"] == {"exif": 26.0}


def test_the_camera(photo, depth, tmp_path):
    matrix = [[60.0, 0.0, 31.0], [0.0, 61.0, 24.0], [0.0, 0.0, 1.0]]
    (tmp_path / "k.txt").write_text("60 0 31\n0 61 24\n0 0 1\n")
    named = dict(fx=60, fy=61, cx=31, cy=24)
    for given in (matrix, np.array(matrix), named, tmp_path / "k.txt"):
        camera = mdenerf.refine(photo, prior_depth=depth, intrinsics=given, **FAST).camera
        np.testing.assert_array_equal(camera.matrix, matrix)
    result = mdenerf.refine(photo, prior_depth=depth, fov=90, **FAST)
    assert abs(result.camera.fx - 32) < 1e-9
    points = result.camera.points(result.depth)
    row, column = 10, 50
    expected = (column - result.camera.cx) / result.camera.fx * result.depth[row, column]
    np.testing.assert_allclose(points[row, column], [expected, points[row, column, 1], result.depth[row, column]], rtol=1e-6)
    with pytest.warns(mdenerf.RefinementWarning, match="field of view of 60 degrees is assumed"):
        mdenerf.refine(photo, prior_depth=depth, **FAST)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"prior_model": "missing.onnx"}, "missing.onnx"),
        ({"prior_model": 3}, "prior_model is of int; give the path"),
        ({}, "one photograph needs a depth: give a prior_model or a prior_depth"),
        ({"prior_depth": np.ones((3, 4, 5))}, "give [height, width]"),
        ({"prior_depth": np.ones((10, 10))}, "the prior is 10x10 but the image is 64x48"),
        ({"prior_depth": np.zeros((48, 64))}, "no usable pixel"),
        ({"prior_depth": "missing.npy"}, "missing.npy"),
        ({"prior_depth": 1, "preset": "fastest"}, "paper, default, fast, multi-view"),
        ({"prior_depth": 1, "config": {"nerf": {"train": {"step": 3}}}}, "step"),
        ({"prior_depth": 1, "config": {"nerf": {"train": {"steps": 0}}}}, "train.steps is 0"),
        ({"prior_depth": 1, "config": "nerf = "}, "config: "),
        ({"prior_depth": 1, "config": "missing.toml"}, "missing.toml"),
        ({"prior_depth": 1, "seed": -1}, "seed is -1"),
        ({"prior_depth": 1, "prior_kind": "metres"}, "metric, depth or disparity"),
        ({"prior_depth": 1, "runtime": "tensorrt", "prior_model": None}, None),
        ({"prior_depth": 1, "intrinsics": np.eye(4)}, "intrinsics has the shape [4, 4]"),
        ({"prior_depth": 1, "intrinsics": [[60, 1, 3], [0, 60, 3], [0, 0, 1]]}, "pinhole"),
        ({"prior_depth": 1, "intrinsics": {"fx": 60}}, "intrinsics has no fy"),
        ({"prior_depth": 1, "intrinsics": "missing.txt"}, "missing.txt"),
        ({"prior_depth": 1, "fov": 200}, "fov: "),
        ({"prior_depth": 1, "depth_range": (9.0, 2.0)}, "depth_range: "),
        ({"prior_depth": 1, "work_size": 0}, "work_size"),
        ({"prior_depth": 1, "max_memory": 0}, "max_memory is 0; give a positive number of GiB"),
        ({"prior_depth": 1, "max_memory": 0.01}, "more than max_memory 0.01"),
        ({"prior_depth": 1, "interval": 1.5}, "interval is 1.5; give 0.01 to 0.99"),
        ({"prior_depth": 1, "calibration": "missing.toml"}, "missing.toml"),
        ({"prior_depth": 1, "scale_from": np.ones((3, 2))}, "scale_from has the shape [3, 2]"),
        ({"prior_depth": 1, "scale_from": np.ones((0, 3))}, "scale_from array: no depth of image"),
        ({"prior_depth": 1, "scale_from": [[3, 4, -1.0]]}, "scale_from array: the known depth -1"),
        ({"prior_depth": 1, "scale_from": "missing.csv"}, "scale_from missing.csv: can't be read"),
        ({"prior_depth": 1, "scale_from": np.ones((3, 3)), "unit": "poses"}, "scale_from gives the unit"),
        ({"prior_depth": 1, "intrinsics": np.diag([1e-9, 60, 1])}, "fx is 1e-9; a focal length is"),
        ({"prior_depth": 1, "views": ["a.png"]}, "with views, give a prior_model or nothing"),
        ({"prior_model": lambda rgb: rgb}, "prior_model: the depth has the shape [48, 64, 3]"),
        ({"prior_model": lambda rgb: rgb[:5, :6, 0] + 1}, "prior_model: the depth is 6x5 but the image is 64x48"),
        ({"prior_model": lambda rgb: rgb[..., 0] * np.nan}, "no usable pixel"),
        ({"prior_model": lambda rgb: "depth"}, "prior_model: the depth is of <U5"),
        ({"prior_model": lambda rgb: rgb, "views": []}, "no further photograph"),
        ({"prior_model": lambda rgb: rgb, "views": "missing"}, "no such folder"),
        ({"prior_model": lambda rgb: rgb, "unit": "poses"}, "unit is 'poses'"),
    ],
)
def test_a_fault_is_one_line(photo, depth, arguments, named):
    if isinstance(arguments.get("prior_depth"), int):
        arguments = {**arguments, "prior_depth": depth}
    if named is None:
        mdenerf.refine(photo, **{**FAST, **arguments})
        return
    with pytest.raises(mdenerf.Error) as raised:
        mdenerf.refine(photo, **arguments)
    assert isinstance(raised.value, ValueError)
    message = str(raised.value)
    assert named in message and len(message.splitlines()) == 1


@pytest.mark.parametrize(
    ("image", "named"),
    [
        (np.zeros((48, 64), np.uint8), "image: the image has the shape [48, 64]; give [height, width, 3]"),
        (np.zeros((48, 64, 4), np.uint8), "[48, 64, 4]"),
        (np.zeros((48, 64, 3), np.int32), "int32"),
        (np.full((48, 64, 3), 255.0), "the image holds 255; give 0 to 1"),
        (np.full((48, 64, 3), np.nan), "NaN"),
        (np.zeros((4, 64, 3), np.uint8), "8x8"),
        ("missing.jpg", "missing.jpg: can't read"),
    ],
)
def test_an_image_at_fault_is_named(depth, image, named):
    with pytest.raises(mdenerf.Error) as raised:
        mdenerf.refine(image, prior_depth=depth)
    assert named in str(raised.value)


def test_an_exception_of_the_model_is_its_own(photo):
    class OutOfMemory(RuntimeError):
        pass

    def model(rgb):
        raise OutOfMemory("on the device")

    with pytest.raises(OutOfMemory, match="on the device"):
        mdenerf.refine(photo, model)


def test_progress_is_reported_and_cancels(photo, depth):
    stages = []
    config = {"refinement": {"order": "paper"}, "nerf": {"train": {"steps": 60, "rays": 64}}}
    mdenerf.refine(photo, prior_depth=depth, config=config, progress=lambda *step: stages.append(step))
    assert ("fit", 0, 0) in stages and ("fit", 60, 60) in stages
    assert all(0 <= done <= total or total == 0 for _, done, total in stages)

    def stop(stage, done, total):
        if stage == "fit":
            raise StopIteration("enough")

    with pytest.raises(StopIteration, match="enough"):
        mdenerf.refine(photo, prior_depth=depth, config=config, progress=stop)


def test_a_refiner_keeps_the_network_and_survives_pickling(photo, network):
    refiner = mdenerf.Refiner(**network, **FAST)
    first = refiner.refine(photo, seed=1)
    again = pickle.loads(pickle.dumps(refiner)).refine(photo, seed=1)
    assert first.depth.tobytes() == again.depth.tobytes() and refiner.runtime == "tract"
    copied = pickle.loads(pickle.dumps(first))
    assert copied.depth.tobytes() == first.depth.tobytes() and copied.camera == first.camera


def test_onnx_runtime_is_used_where_it_is_installed(photo, network):
    tract = mdenerf.Refiner(**network, **FAST)
    auto = mdenerf.Refiner(**{**network, "runtime": "auto"}, **FAST)
    pytest.importorskip("onnxruntime")
    assert auto.runtime.startswith("ONNX Runtime"), auto.runtime
    np.testing.assert_allclose(auto.refine(photo).depth, tract.refine(photo).depth, rtol=1e-3)


def test_any_number_of_threads_gives_the_same_bytes(photo, depth):
    config = {"refinement": {"order": "paper"}, "nerf": {"train": {"steps": 30, "rays": 64}}}
    one, three = (mdenerf.refine(photo, prior_depth=depth, config=config, threads=n) for n in (1, 3))
    assert one.depth.tobytes() == three.depth.tobytes() and one.sigma.tobytes() == three.sigma.tobytes()
    assert (one.run["threads"], three.run["threads"]) == (1, 3)


def test_the_interpreter_is_free_meanwhile(photo, depth):
    """Another Python thread runs during a refinement, and two refinements overlap."""
    config = {"refinement": {"order": "paper"}, "nerf": {"train": {"steps": 150, "rays": 128}}}
    spans = []
    ticks = 0
    stop = threading.Event()

    def tick():
        nonlocal ticks
        while not stop.is_set():
            ticks += 1
            time.sleep(0.001)

    def refine():
        start = time.monotonic()
        mdenerf.refine(photo, prior_depth=depth, config=config, threads=1)
        spans.append((start, time.monotonic()))

    threads = [threading.Thread(target=refine) for _ in range(2)]
    ticker = threading.Thread(target=tick)
    ticker.start()
    begun = time.monotonic()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    seconds = time.monotonic() - begun
    stop.set()
    ticker.join()
    (a, b), (c, d) = spans
    assert max(a, c) < min(b, d), "one ran after the other"
    assert ticks > 20 * seconds, f"{ticks} ticks in {seconds:.1f} s"


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_cancels(tmp_path):
    script = textwrap.dedent(
        """
        import numpy as np, mdenerf, signal, time
        # A shell has its jobs in the background ignore it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        image = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)
        begun = time.monotonic()
        def progress(stage, done, total):
            if stage == "fit":
                print("fit", flush=True)
        try:
            mdenerf.refine(image, prior_depth=np.full((96, 128), 2.0), config={"refinement": {"order": "paper"}, "nerf": {"train": {"steps": 1000000}}}, progress=progress)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline().strip() == "fit"
        process.send_signal(signal.SIGINT)
        begun = time.monotonic()
        rest = process.communicate(timeout=60)[0]
    finally:
        process.kill()
    assert rest.splitlines()[-1] == "interrupted" and process.returncode == 0
    assert time.monotonic() - begun < 20


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_refines_too(photo, depth):
    """Its parent's threads are not in it."""
    expected = mdenerf.refine(photo, prior_depth=depth, **FAST)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(write, mdenerf.refine(photo, prior_depth=depth, **FAST).depth.tobytes()[:64])
        finally:
            os._exit(0)
    os.close(write)
    assert os.read(read, 64) == expected.depth.tobytes()[:64]
    os.waitpid(child, 0)


def test_a_map_from_a_file_is_known_by_its_metadata(photo, photo_file, depth, mde, tmp_path):
    """Its unit, and that its bits are few."""
    result = mdenerf.refine(photo, prior_depth=depth, prior_kind="depth", **FAST)
    saved = result.save(tmp_path / "out", report=False)
    with pytest.warns(mdenerf.RefinementWarning, match='have the unit "unscaled".*prior_kind metric'):
        again = mdenerf.refine(photo, prior_depth=saved / "depth.png", **FAST)
    assert again.unit == "unscaled"
    assert mdenerf.refine(photo, prior_depth=saved / "depth.png", prior_kind="metric", **FAST).unit == "m"
    pillow = pytest.importorskip("PIL.Image")
    pillow.fromarray(np.uint8(np.clip(500 / depth, 0, 255))).save(tmp_path / "few.png")
    with pytest.warns(mdenerf.RefinementWarning, match="8 bits hold 256 levels"):
        mdenerf.refine(photo, prior_depth=tmp_path / "few.png", prior_kind="disparity", **FAST)
