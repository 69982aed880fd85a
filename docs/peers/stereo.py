"""Depth maps of two other programs for captures with poses, in the layout that `mde eval --methods NAME=FOLDER` reads.

    python3 -m venv env && env/bin/pip install opencv-python-headless numpy
    env/bin/python docs/peers/stereo.py POSED maps/sgbm --method sgbm
    env/bin/python docs/peers/stereo.py POSED maps/colmap --method colmap
    mde eval POSED --dataset posed --size 320x240 --prior-model fastdepth_224.onnx --methods sgbm=maps/sgbm,colmap=maps/colmap \\
        -o out/peers

sgbm    OpenCV's semi-global matching of the reference with every further photograph, rectified by the given poses. Per pixel the
        median of the largest set of depths within 10 % of each other; holes take the nearest pixel's depth. Pairs that stand
        behind each other cannot be rectified; a capture of such pairs alone has no map.
colmap  COLMAP's features, matches and triangulation with the given poses (`colmap` must be on PATH; Debian's package will do). Log
        depth is interpolated from the nearest 8 points with the inverse squares of their distances as weights.

Poses and photographs alone are read, never a depth. Not part of the build and of no test.
"""

import argparse
import json
import os
import sqlite3
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

DISPARITIES = 96  # surfaces of a match at 320 pixels of width
BLOCK = 5  # pixels of a window's side
AGREE = 0.1  # relative difference of depths that agree
NEIGHBOURS = 8


class View:
    """A photograph without lens distortion, its intrinsic matrix (pixel centres at integers) and world-to-camera pose."""

    def __init__(self, folder, document, frame):
        def field(name, default=0.0):
            return frame.get(name, document.get(name, default))

        image = cv2.imread(str(folder / frame["file_path"]), cv2.IMREAD_COLOR)
        self.name = Path(frame["file_path"]).stem
        self.k = np.array([[field("fl_x"), 0, field("cx")], [0, field("fl_y"), field("cy")], [0, 0, 1]], float)
        lens = np.array([field(name) for name in ("k1", "k2", "p1", "p2", "k3")], float)
        self.image = cv2.undistort(image, self.k, lens) if lens.any() else image
        to_world = np.array(frame["transform_matrix"], float)
        to_world[:3, 1:3] *= -1  # OpenGL's axes to y down, z forward
        self.pose = np.linalg.inv(to_world)

    def resized(self, width, height):
        other = object.__new__(View)
        rows, columns = self.image.shape[:2]
        sx, sy = width / columns, height / rows
        other.name, other.pose = self.name, self.pose
        other.image = cv2.resize(self.image, (width, height), interpolation=cv2.INTER_AREA)
        other.k = self.k.copy()
        other.k[0] *= sx
        other.k[1] *= sy
        other.k[0, 2] = (self.k[0, 2] + 0.5) * sx - 0.5
        other.k[1, 2] = (self.k[1, 2] + 0.5) * sy - 0.5
        return other


def scenes(root):
    for path in sorted(root.rglob("transforms.json")):
        folder = path.parent
        if (folder / "scene.json").is_file():
            document = json.loads(path.read_text())
            scene = json.loads((folder / "scene.json").read_text())
            views = [View(folder, document, frame) for frame in document["frames"]]
            reference = scene.get("reference", 0)
            further = scene.get("extra_views", range(len(views)))
            yield folder.relative_to(root), views[reference], [views[i] for i in further if i != reference]


def motion(reference, other):
    return other.pose @ np.linalg.inv(reference.pose)


def pair(reference, other):
    """Depth of the reference from one rectified pair; 0 where unmatched. None where the cameras stand behind each other."""
    relative = motion(reference, other)
    rotation = relative[:3, :3]
    centre = -rotation.T @ relative[:3, 3]  # of the other camera, seen from the reference
    baseline = np.linalg.norm(centre)
    # Both cameras are turned so that the baseline is their x axis and the second stands to the right.
    x = centre / baseline
    ahead = np.array([0, 0, 1.0]) + rotation.T @ [0, 0, 1.0]
    z = ahead - x * (ahead @ x)
    if baseline == 0 or np.linalg.norm(z) < 0.3 * np.linalg.norm(ahead):
        return None
    z /= np.linalg.norm(z)
    turn = np.stack([x, np.cross(z, x), z])
    height, width = reference.image.shape[:2]
    corners = np.array([[0, 0, 1], [width - 1, 0, 1], [0, height - 1, 1], [width - 1, height - 1, 1]], float).T
    focal = (reference.k[0, 0] + reference.k[1, 1]) / 2
    homographies, boxes = [], []
    for view, r in ((reference, turn), (other, turn @ rotation.T)):
        homographies.append(np.diag([focal, focal, 1]) @ r @ np.linalg.inv(view.k))
        seen = homographies[-1] @ corners
        if seen[2].min() < 0.1:
            return None
        boxes.append((seen[:2] / seen[2]).T)
    low = [box.min(0) for box in boxes]
    top = min(low[0][1], low[1][1])
    canvas_height = int(np.ceil(max(box[:, 1].max() for box in boxes) - top)) + 1
    canvas_width = int(np.ceil(max(np.ptp(box[:, 0]) for box in boxes))) + 1
    if canvas_width * canvas_height > 8 * width * height:
        return None
    images = []
    for i, view in enumerate((reference, other)):
        homographies[i] = np.array([[1, 0, -low[i][0]], [0, 1, -top], [0, 0, 1]]) @ homographies[i]
        images.append(cv2.warpPerspective(view.image, homographies[i], (canvas_width, canvas_height)))
    # The disparity of what is infinitely far: the canvases begin at different columns.
    infinite = low[1][0] - low[0][0]
    count = 16 * int(np.ceil(DISPARITIES * width / 320 / 16))
    first = int(np.floor(infinite))
    matcher = cv2.StereoSGBM_create(
        minDisparity=first,
        numDisparities=count,
        blockSize=BLOCK,
        P1=8 * 3 * BLOCK**2,
        P2=32 * 3 * BLOCK**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    # The matcher leaves out columns whose match may lie outside.
    side = count + abs(first) + BLOCK
    margin = ((0, 0), (side, side), (0, 0))
    disparity = matcher.compute(*(np.pad(image, margin) for image in images))[:, side:-side]
    found = disparity >= 16 * first
    disparity = disparity.astype(float) / 16 - infinite
    rows, columns = np.mgrid[:height, :width]
    rays = np.stack([columns, rows, np.ones_like(rows)]).reshape(3, -1).astype(float)
    at = homographies[0] @ rays
    column, row = np.rint(at[:2] / at[2]).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < canvas_width) & (row < canvas_height)
    column, row = np.clip(column, 0, canvas_width - 1), np.clip(row, 0, canvas_height - 1)
    d = disparity[row, column]
    good = inside & found[row, column] & (d > 0.25)
    # Depth along the turned axis, over the length of the pixel's ray along it.
    along = (turn @ np.linalg.inv(reference.k) @ rays)[2]
    depth = focal * baseline / np.where(good, d, 1) / along
    return np.where(good, depth, 0).reshape(height, width)


def sgbm(reference, others, size):
    reference = reference.resized(*size)
    maps = [pair(reference, other.resized(*size)) for other in others]
    maps = np.array([z for z in maps if z is not None])
    if len(maps) == 0:
        return np.zeros(size[::-1]), 0.0
    with np.errstate(divide="ignore"):
        logs = np.where(maps > 0, np.log(np.maximum(maps, 1e-9)), np.nan)
    agree = np.abs(logs[:, None] - logs[None]) < AGREE
    best = np.argmax(agree.sum(1), axis=0)
    chosen = np.take_along_axis(agree, best[None, None], axis=0)[0]
    sets = np.where(chosen, logs, np.nan)
    known = chosen.any(0)
    sets[:, ~known] = 0.0
    depth = np.where(known, np.exp(np.nanmedian(sets, axis=0)), 0)
    return nearest(depth), known.mean()


def nearest(depth):
    """Holes take the depth of the nearest pixel that has one."""
    if not (depth > 0).any():
        return depth
    _, labels = cv2.distanceTransformWithLabels(
        (depth <= 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros(labels.max() + 1)
    table[labels[depth > 0]] = depth[depth > 0]
    return table[labels]


def rotation_to_quaternion(r):
    w, x, y, z = np.linalg.eigh(
        np.array(
            [
                [r[0, 0] + r[1, 1] + r[2, 2], 0, 0, 0],
                [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], 0, 0],
                [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0],
                [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1]],
            ]
        ),
        "L",
    )[1][:, -1]
    return w, x, y, z


def colmap(reference, others, size):
    views = [reference, *others]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for part in ("images", "given", "found"):
            (folder / part).mkdir()
        for view in views:
            cv2.imwrite(str(folder / "images" / f"{view.name}.png"), view.image)
        k = reference.k
        # COLMAP's pixel centres are at halves.
        parameters = f"{k[0, 0]},{k[1, 1]},{k[0, 2] + 0.5},{k[1, 2] + 0.5}"
        database = folder / "database.db"

        def run(command, *arguments):
            environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
            subprocess.run(["colmap", command, *map(str, arguments)], check=True, capture_output=True, env=environment)

        run("feature_extractor", "--database_path", database, "--image_path", folder / "images",
            "--ImageReader.single_camera", 1, "--ImageReader.camera_model", "PINHOLE",
            "--ImageReader.camera_params", parameters, "--SiftExtraction.use_gpu", 0)  # fmt: skip
        run("exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", 0)
        with sqlite3.connect(database) as connection:
            rows = dict(connection.execute("select name, image_id from images").fetchall())
        height, width = reference.image.shape[:2]
        (folder / "given/cameras.txt").write_text(f"1 PINHOLE {width} {height} {parameters.replace(',', ' ')}\n")
        lines = []
        for view in views:
            name = f"{view.name}.png"
            numbers = [*rotation_to_quaternion(view.pose[:3, :3]), *view.pose[:3, 3]]
            lines.append(f"{rows[name]} {' '.join(map(repr, map(float, numbers)))} 1 {name}\n\n")
        (folder / "given/images.txt").write_text("".join(lines))
        (folder / "given/points3D.txt").write_text("")
        run("point_triangulator", "--database_path", database, "--image_path", folder / "images",
            "--input_path", folder / "given", "--output_path", folder / "found")  # fmt: skip
        run("model_converter", "--input_path", folder / "found", "--output_path", folder / "found",
            "--output_type", "TXT")  # fmt: skip
        own = str(rows[f"{reference.name}.png"])
        points = []
        for line in (folder / "found/points3D.txt").read_text().splitlines():
            fields = line.split()
            if line.startswith("#") or own not in fields[8::2]:
                continue
            at = reference.pose[:3, :3] @ np.array(fields[1:4], float) + reference.pose[:3, 3]
            if at[2] > 0:
                seen = k @ at
                points.append((seen[0] / at[2], seen[1] / at[2], np.log(at[2])))
    if not points:
        return np.zeros(size[::-1]), 0.0
    points = np.array(points)
    columns = (np.arange(size[0]) + 0.5) * width / size[0] - 0.5
    rows = (np.arange(size[1]) + 0.5) * height / size[1] - 0.5
    depth = np.zeros(size[::-1])
    count = min(NEIGHBOURS, len(points))
    for i, row in enumerate(rows):
        squares = (columns[:, None] - points[None, :, 0]) ** 2 + (row - points[None, :, 1]) ** 2
        near = np.argpartition(squares, count - 1, axis=1)[:, :count]
        weights = 1 / (np.take_along_axis(squares, near, axis=1) + 0.25)
        depth[i] = np.exp((weights * points[near, 2]).sum(1) / weights.sum(1))
    return depth, len(points)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", type=Path, help="folder of captures: SET/SCENE/transforms.json with scene.json")
    parser.add_argument("output", type=Path, help="maps go to OUTPUT/SET/SCENE.npy")
    parser.add_argument("--method", choices=("sgbm", "colmap"), required=True)
    parser.add_argument("--size", default="320x240", help="of the maps, as that of mde eval; default: 320x240")
    arguments = parser.parse_args()
    size = tuple(int(side) for side in arguments.size.split("x"))
    method, what = {"sgbm": (sgbm, "share matched"), "colmap": (colmap, "points")}[arguments.method]
    for scene, reference, others in scenes(arguments.captures):
        depth, found = method(reference, others, size)
        if not (depth > 0).any():
            print(f"{scene}: no depth")
            continue
        path = arguments.output / scene.with_name(f"{scene.name}.npy")
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, depth.astype(np.float32))
        print(f"{scene}: {what} {found:.2f}" if method is sgbm else f"{scene}: {what} {found}")


if __name__ == "__main__":
    main()
