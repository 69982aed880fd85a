"""Builds the package with maturin, and puts the program `mde` into the wheel."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import build_sdist, get_requires_for_build_sdist, prepare_metadata_for_build_wheel

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

HERE = Path(__file__).resolve().parent
get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
get_requires_for_build_editable = maturin.get_requires_for_build_editable
prepare_metadata_for_build_editable = maturin.prepare_metadata_for_build_editable


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    _program()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    _program()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


def _program():
    """Compiles the program into `mdenerf/bin`."""
    # In the repository this folder is a member of the workspace; a source distribution has its sources beside `mde-cli`.
    workspace = HERE if (HERE / "mde-cli").is_dir() else HERE.parent
    manifest = workspace / "mde-cli" / "Cargo.toml"
    command = ["cargo", "build", "--locked", "--release", "--bin", "mde", "--manifest-path", manifest]
    command.append("--message-format=json-render-diagnostics")
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    executables = [json.loads(line).get("executable") for line in output.splitlines() if line.startswith("{")]
    program = Path([path for path in executables if path][-1])
    package = next(path for path in (HERE / "python", HERE / "mde-py" / "python") if path.is_dir()) / "mdenerf"
    target = package / "bin" / program.name
    target.parent.mkdir(exist_ok=True)
    temporary = target.with_name(target.name + ".new")
    shutil.copy2(program, temporary)
    if strip := shutil.which("strip"):
        # The debug information is larger than the program. A strip that does not know the format leaves it as it is.
        subprocess.run([strip, temporary], check=False)
    os.replace(temporary, target)
