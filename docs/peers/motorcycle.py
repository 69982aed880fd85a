"""The Motorcycle pair of Middlebury 2014 (Scharstein et al., GCPR 2014), from the files that scikit-image 0.15 brings.

    pip download scikit-image==0.15.0 --no-deps --only-binary=:all: --python-version 3.7 --platform manylinux1_x86_64
    unzip scikit_image-0.15.0-*.whl 'skimage/data/motorcycle*'
    python3 docs/peers/motorcycle.py skimage/data motorcycle

Writes left.png, right.png and truth.npy (z in metres, 0 where unknown). The two cameras differ in their principal points by 31.086
pixels; both photographs are cut so that one camera holds for both. NumPy and Pillow are needed. Not part of the build and of no test.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

FOCAL, BASELINE, OFFSET = 994.978, 0.193001, 31.086  # pixels, metres, pixels


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True)
    left, right = (Image.open(arguments.data / f"motorcycle_{side}.png") for side in ("left", "right"))
    disparity = np.load(arguments.data / "motorcycle_disp.npz")["arr_0"]
    width, height = left.size
    cut = round(OFFSET)
    left.crop((0, 0, width - cut, height)).save(arguments.output / "left.png")
    right.crop((cut, 0, width, height)).save(arguments.output / "right.png")
    known = np.isfinite(disparity)
    depth = np.where(known, FOCAL * BASELINE / np.where(known, disparity + OFFSET, 1), 0)
    np.save(arguments.output / "truth.npy", depth[:, : width - cut].astype(np.float32))


if __name__ == "__main__":
    main()
