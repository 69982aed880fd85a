"""What a result shows and saves."""

import base64
import json
import re
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import mdenerf

FAST = {"preset": "fast"}


@pytest.fixture(scope="module")
def result(photo, depth):
    return mdenerf.refine(photo, prior_depth=depth, **FAST)


def test_it_saves_what_the_program_saves(photo_file, network, arguments, mde, tmp_path):
    mde("refine", photo_file, *arguments, "-o", tmp_path / "program")
    saved = mdenerf.refine(photo_file, **network).save(tmp_path / "deep" / "package")
    names = {path.name for path in (tmp_path / "program").iterdir()}
    assert names == {path.name for path in saved.iterdir()}
    for name in names - {"run.json", "report.html"}:
        assert (saved / name).read_bytes() == (tmp_path / "program" / name).read_bytes(), name
    ours, theirs = (json.loads((folder / "run.json").read_text()) for folder in (saved, tmp_path / "program"))
    assert set(theirs) - set(ours) == {"command_line"}
    for key in ("files", "unit", "error_bar", "png_scale", "missing_pixels", "preset", "seed", "iterations", "camera", "input"):
        assert ours[key] == theirs[key], key
    assert "<title>" in (saved / "report.html").read_text(encoding="utf-8")


def test_a_folder_is_replaced_only_by_force_and_if_it_is_of_a_run(result, tmp_path):
    folder = result.save(tmp_path / "out", report=False)
    with pytest.raises(mdenerf.Error, match="force=True to replace it"):
        result.save(folder)
    (folder / "old.txt").touch()
    result.save(folder, force=True, report=False)
    assert not (folder / "old.txt").exists() and not (folder / "report.html").exists()
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    (thesis / "thesis.txt").touch()
    with pytest.raises(mdenerf.Error, match="holds no run.json"):
        result.save(thesis, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "thesis"]
    (tmp_path / "file").touch()
    with pytest.raises(mdenerf.Error, match="can't write|not a folder"):
        result.save(tmp_path / "file" / "out")


def test_a_foreign_record_protects_its_folder(result, tmp_path):
    for content in ("", "hello", "{}", "[]"):
        (tmp_path / "run.json").write_text(content)
        with pytest.raises(mdenerf.Error, match="holds no run.json"):
            result.save(tmp_path, force=True)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="folders are exchanged in one step on Linux")
def test_a_folder_is_there_while_it_is_replaced(result, tmp_path):
    folder = result.save(tmp_path / "out", report=False)
    watch = textwrap.dedent(
        f"""
        import os, sys
        print("ready", flush=True)
        missing = 0
        while not os.path.exists({str(tmp_path / "stop")!r}):
            for _ in range(1000):
                try:
                    os.stat({str(folder / "run.json")!r})
                except FileNotFoundError:
                    missing += 1
        print(missing)
        """
    )
    watcher = subprocess.Popen([sys.executable, "-c", watch], stdout=subprocess.PIPE, text=True)
    assert watcher.stdout.readline().strip() == "ready"
    for _ in range(100):
        result.save(folder, force=True, report=False)
    (tmp_path / "stop").touch()
    assert int(watcher.communicate(timeout=60)[0]) == 0


def test_the_interpreter_is_free_while_it_is_saved(ticker, tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (600, 800, 3), dtype=np.uint8)
    result = mdenerf.refine(image, prior_depth=np.full((600, 800), 2.0), no_nerf=True, preset="fast")
    assert ticker(lambda: result.save(tmp_path / "out", report=False, export=["ply"], force=True)) < 0.5


def test_an_unknown_format_is_named(result, tmp_path):
    with pytest.raises(mdenerf.Error, match="export: unknown variant `obj`, expected one of `ply`, `glb`, `exr`, `colmap`, `colmap-dense`, `mesh`, `transforms`, `sigma`"):
        result.save(tmp_path / "out", export=["ply", "obj"])
    assert list(tmp_path.iterdir()) == []


def test_a_notebook_shows_it(result):
    page = result._repr_html_()
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(pictures) == 3 and "sigma" in page
    assert all(base64.b64decode(picture).startswith(b"\x89PNG") for picture in pictures)
    assert repr(result).startswith("Result(64x48, median depth ")
    wide = mdenerf.refine(np.zeros((40, 1000, 3), np.uint8), prior_depth=np.full((40, 1000), 2.0), **FAST)
    assert len(wide._repr_html_()) < 20_000


def test_the_settings_of_a_result_repeat_it(result, photo, depth):
    again = mdenerf.refine(photo, prior_depth=depth, config=result.config)
    assert again.depth.tobytes() == result.depth.tobytes() and again.sigma.tobytes() == result.sigma.tobytes()


def test_the_program_is_part_of_the_package(mde):
    version = mde("--version").stdout
    assert version.startswith("mde ")
    as_module = subprocess.run(
        [sys.executable, "-m", "mdenerf", "--version"], check=True, capture_output=True, text=True
    )
    assert as_module.stdout == version
