"""Rotation errors of `mde poses` on random parts of captures.

    python3 docs/peers/subsets.py POSED --prior-model fastdepth_224.onnx --mde target/release/mde --seed 3

Each set has 2 to 5 photographs of one capture, 640 pixels wide at most, or half or three quarters of that, as PNG or as JPEG of
quality 40 or 70, and the capture's camera. Prints a line per set with the error of each further photograph against the file's
poses, and a summary. NumPy and Pillow are needed. Not part of the build and of no test.
"""

import argparse
import json
import random
import statistics
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH = 640


def rotation(frame):
    """The nearest rotation: those of some files are rounded."""
    left, _, right = np.linalg.svd(np.array(frame["transform_matrix"], float)[:3, :3])
    return left @ right


def angle(a, b):
    """Degrees between two rotations."""
    return np.degrees(2 * np.arcsin(min(1, np.linalg.norm(a - b) / 8**0.5)))


def resized(frames, folder, target, scale, quality):
    """Writes the photographs; returns their paths and the factor on the camera."""
    paths = []
    for index, frame in enumerate(frames):
        image = Image.open(folder / frame["file_path"]).convert("RGB")
        factor = scale * min(1, WIDTH / image.width)
        image = image.resize((round(image.width * factor), round(image.height * factor)), Image.LANCZOS)
        path = Path(target) / f"{index}.{'jpg' if quality else 'png'}"
        image.save(path, **({"quality": quality} if quality else {}))
        paths.append(path)
    return paths, factor


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path)
    parser.add_argument("--prior-model", required=True)
    parser.add_argument("--mde", default="mde")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=90)
    arguments = parser.parse_args()
    captures = sorted(arguments.captures.glob("*/*/transforms.json"), key=str)
    if not captures:
        parser.error(f"{arguments.captures}: no */*/transforms.json")
    random.seed(arguments.seed)
    asked, errors = 0, []
    for _ in range(arguments.sets):
        capture = random.choice(captures)
        document = json.loads(capture.read_text())
        count = min(random.choice([2, 3, 3, 4, 5]), len(document["frames"]))
        frames = random.sample(document["frames"], count)
        scale, quality = random.choice([1, 1, 0.5, 0.75]), random.choice([None, None, 40, 70])
        asked += count - 1
        with tempfile.TemporaryDirectory() as target:
            paths, factor = resized(frames, capture.parent, target, scale, quality)
            focal = [f"--f{a}={document[f'fl_{a}'] * factor}" for a in "xy"]
            centre = [f"--c{a}={(document[f'c{a}'] + 0.5) * factor - 0.5}" for a in "xy"]
            found = Path(target) / "found.json"
            command = [arguments.mde, "poses", *paths, "--prior-model", arguments.prior_model, *focal, *centre, "-o", found]
            run = subprocess.run(list(map(str, command)), capture_output=True, text=True)
            name = f"{capture.parent.name}, {count} photographs, scale {scale}, quality {quality}"
            if run.returncode != 0:
                print(f"{name}: {(run.stderr.strip().splitlines() or ['no message'])[-1]}", flush=True)
                continue
            posed = {Path(f["file_path"]).name: rotation(f) for f in json.loads(found.read_text())["frames"]}
        true = {path.name: rotation(frame) for path, frame in zip(paths, frames)}
        first, *others = [name for name in true if name in posed]
        these = [angle(posed[first].T @ posed[o], true[first].T @ true[o]) for o in others]
        errors += these
        print(f"{name}: {', '.join(f'{e:.2f}' for e in these)} degrees, {count - 1 - len(others)} left out", flush=True)
    errors.sort()
    if errors:
        ninth = errors[int(0.9 * len(errors))]
        above = ", ".join(f"{e:.1f}" for e in errors if e > 2) or "none"
        print(f"{len(errors)} of {asked} have a pose; median {statistics.median(errors):.2f} degrees, 90 % within {ninth:.2f}, above 2: {above}")


if __name__ == "__main__":
    main()
