"""Copies of captures with noisy poses, for `mde eval --dataset posed`.

    python3 docs/peers/noisy.py POSED noisy --degrees 0.3
    mde eval noisy --dataset posed --size 320x240 --prior-model fastdepth_224.onnx --methods multi-view --alignment median-ratio -o out/noisy

Every photograph but the reference is turned by the angle about a random axis, and its centre moved by 20 mm per degree in a
random direction. Photographs and depths are links. NumPy alone is needed. Not part of the build and of no test.
"""

import argparse
import json
from pathlib import Path

import numpy as np


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--degrees", type=float, default=0.3)
    arguments = parser.parse_args()
    for path in sorted(arguments.captures.rglob("transforms.json")):
        folder = path.parent
        if not (folder / "scene.json").is_file():
            continue
        target = arguments.output / folder.relative_to(arguments.captures)
        target.mkdir(parents=True)
        for other in folder.iterdir():
            if other != path:
                (target / other.name).symlink_to(other.resolve())
        document = json.loads(path.read_text())
        reference = json.loads((folder / "scene.json").read_text()).get("reference", 0)
        # The same noise whatever else is in the folder.
        draw = np.random.default_rng([ord(letter) for letter in folder.name])
        for index, frame in enumerate(document["frames"]):
            axis, direction = (v / np.linalg.norm(v) for v in draw.normal(size=(2, 3)))
            if index == reference:
                continue
            angle = np.radians(arguments.degrees)
            cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
            matrix = np.array(frame["transform_matrix"], float)
            matrix[:3, :3] = matrix[:3, :3] @ turn
            matrix[:3, 3] += 0.02 * arguments.degrees * direction
            frame["transform_matrix"] = matrix.tolist()
        (target / "transforms.json").write_text(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
