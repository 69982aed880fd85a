"""Many photographs, each alone or on one scale, with the bytes of `mde refine PHOTOS`."""

import csv
import warnings

import numpy as np
import pytest

import mdenerf
from mdenerf import _mdenerf as native

from conftest import NETWORK
from test_same_bytes import same, same_files

#: Depth by the brightness, so that exposures give depths of different scales.
GREY = {"prior_model": str(NETWORK.with_name("grey_nchw.onnx")), "model_profile": "fastdepth", "runtime": "tract"}
PROGRAM = ["--prior-model", GREY["prior_model"], "--model-profile", GREY["model_profile"], "--predictions", 1, "--fov", 60]


@pytest.fixture(scope="module")
def burst(tmp_path_factory):
    """A folder with a scene at three exposures, and another scene."""
    folder = tmp_path_factory.mktemp("burst")
    noise = np.random.default_rng(5).random((2, 21, 28))
    coarse, other = (np.kron(one, np.ones((8, 8))) for one in noise)
    fine = np.random.default_rng(6).random(coarse.shape)
    for name, texture, gain in [("a", coarse, 1.0), ("b", coarse, 0.8), ("c", coarse, 0.64), ("d", other, 1.0)]:
        grey = gain * (60 + 140 * texture + 40 * fine)
        pixels = np.uint8(np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2))
        (folder / f"{name}.png").write_bytes(native.encode_png(pixels))
    return folder


def test_photographs_on_one_scale(burst, mde, tmp_path):
    mde("refine", burst, *PROGRAM, "--same-scale", "--export", "sigma", "-o", tmp_path / "out")
    refiner = mdenerf.Refiner(**GREY, predictions=1)
    calls = []
    with pytest.warns(mdenerf.RefinementWarning, match="same_scale: matches no other photograph") as caught:
        results = list(refiner.refine_many(burst, same_scale=True, fov=60, progress=lambda *call: calls.append(call)))
    assert {warning.filename for warning in caught} == {__file__}
    assert [call for call in calls if call[0] == "match"] == [("match", 4, 4)]
    assert [call for call in calls if call[0] == "photograph"] == [("photograph", done, 4) for done in (1, 2, 3, 4)]
    with open(tmp_path / "out" / "index.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    for row, result in zip(rows, results, strict=True):
        folder = tmp_path / "out" / row["folder"]
        same(result, folder)
        saved = result.save(tmp_path / "saved" / row["folder"], export="sigma")
        (folder / "finished.json").unlink()
        same_files(saved, folder)
        assert f"{result.run['same_scale']['factor']:.6f}" == row["same_scale"]
    scales = refiner.same_scale(sorted(burst.iterdir()), fov=60)
    assert [scale.group for scale in scales] == [0, 0, 0, 1] and [scale.photographs for scale in scales] == [3, 3, 3, 1]
    # The brightness is the depth: each factor undoes an exposure.
    factors = np.array([scale.factor for scale in scales])
    np.testing.assert_allclose(factors[1:3] / factors[0], [1 / 0.8, 1 / 0.64], rtol=0.02)
    assert factors[3] == 1 and scales[0].log_sigma > 0
    by_hand = refiner.refine(burst / "b.png", same_scale=scales[1], fov=60)
    assert by_hand.depth.tobytes() == results[1].depth.tobytes()
    # Without it, the depths differ as the exposures do.
    plain = list(mdenerf.refine_many(burst, **GREY, predictions=1, fov=60))
    spread = [np.ptp([np.log(np.median(one.depth)) for one in some[:3]]) for some in (plain, results)]
    assert spread[0] > 0.4 and spread[1] < 0.05


def test_a_callable_has_a_scale_too(burst):
    def network(rgb):
        return 1 + rgb.mean(axis=2)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mdenerf.RefinementWarning)
        refiner = mdenerf.Refiner(network, prior_kind="depth", predictions=1, threads=1)
        scales = refiner.same_scale(burst, fov=60)
        assert scales[0].factor < scales[1].factor < scales[2].factor
        once = [scale.factor for scale in mdenerf.Refiner(network, prior_kind="depth", predictions=1).same_scale(burst, fov=60)]
    assert once == [scale.factor for scale in scales]

    def broken(rgb):
        raise ZeroDivisionError("the model's own")

    with pytest.raises(ZeroDivisionError, match="the model's own"):
        mdenerf.Refiner(broken, predictions=1).same_scale(burst)


def test_one_that_fails_ends_the_others_or_is_given_in_its_place(burst, photo, tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no photograph")
    images = [burst / "a.png", tmp_path / "broken.png", photo]
    refiner = mdenerf.Refiner(**GREY, predictions=1)
    for same_scale in (False, True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mdenerf.RefinementWarning)
            found = list(refiner.refine_many(iter(images), same_scale=same_scale, fov=60, return_exceptions=True))
        assert [type(one) for one in found] == [mdenerf.Result, mdenerf.Error, mdenerf.Result]
        assert "no readable image" in str(found[1])
    both = [tmp_path / "broken.png"] * 2
    found = list(refiner.refine_many(both, same_scale=True, return_exceptions=True))
    assert [type(one) for one in found] == [mdenerf.Error] * 2
    results = refiner.refine_many(images, fov=60)
    assert next(results).depth.shape == (168, 224)
    with pytest.raises(mdenerf.Error, match="broken.png"):
        next(results)


def test_what_has_no_scale_in_common_is_refused(burst, photo, depth, tmp_path):
    refiner = mdenerf.Refiner(**GREY, predictions=1)
    scale = mdenerf.SameScale(1.0, 0.1, 0, 2)
    for call, word in [
        (lambda: mdenerf.Refiner().same_scale(burst), "needs a prior_model"),
        (lambda: mdenerf.Refiner().refine_many([photo]), "needs a prior_model"),
        (lambda: refiner.refine_many(tmp_path / "absent"), "no such folder"),
        (lambda: refiner.refine_many(tmp_path), "holds no photograph"),
        (lambda: refiner.refine(photo, same_scale=scale, views=[photo]), "leave views and scale_from out"),
        (lambda: refiner.same_scale(burst, intrinsics=np.eye(3), fov=60), "both given"),
        (lambda: refiner.same_scale(burst, intrinsics=tmp_path / "no.json"), "no.json"),
        (lambda: refiner.same_scale([tmp_path / "no.png"]), "no.png"),
        (lambda: mdenerf.Refiner(**GREY, predictions=1, max_memory=1e-6).same_scale(burst), "max_memory"),
        (lambda: mdenerf.refine_many([photo], GREY["prior_model"], depth_range=(-1, 2)), "depth_range: "),
        (lambda: mdenerf.refine_many([photo], GREY["prior_model"], predictions=0), "predictions"),
    ]:
        with pytest.raises(mdenerf.Error, match=word):
            call()
