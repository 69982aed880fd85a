"""Scores `mde dense` on a long capture: every depth map, the cloud, processor time and memory by the number of photographs.

    python3 -m venv env && env/bin/pip install numpy pillow scipy
    env/bin/python docs/peers/captures.py CAPTURE/transforms.json --mde target/release/mde -o out/captures -- --no-nerf

The file's frames need a `depth_file_path` (16 bits, thousandths of the poses' unit unless `depth_unit_scale_factor` says otherwise) of
their photographs' size; the program never reads it. Runs have the first 10, 20, ... photographs; what follows `--` goes to the program.
Depths are scaled by the median of ratios. The true cloud is that of all true depths, thinned like ours to a voxel of a quarter of the
tolerance; accuracy is the share of our points that have a true one within the tolerance, completeness the share of true ones that
have ours, F their harmonic mean. `--sevens N` refines N photographs, each with the six nearest alone, for comparison with the same
photographs of the largest run. Not part of the build and of no test.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

TOLERANCES = (0.01, 0.02, 0.05)  # of the median true depth


def run(command, folder):
    """Processor seconds of a run and its record; a folder that is there is taken as it is."""
    seconds = folder.with_suffix(".seconds")
    if not seconds.is_file():
        process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{' '.join(map(str, command))}: exit status {os.waitstatus_to_exitcode(status)}")
        seconds.write_text(str(usage.ru_utime + usage.ru_stime))
    return float(seconds.read_text()), json.loads((folder / "run.json").read_text())


def subset(document, frames, folder):
    """A capture of some of the frames, without their depths."""
    kept = [{key: value for key, value in frame.items() if not key.startswith("depth")} for frame in frames]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps({**document, "frames": kept}))
    return folder / "transforms.json"


def truth(document, frame):
    scale = frame.get("depth_unit_scale_factor", document.get("depth_unit_scale_factor", 1e-3))
    return np.asarray(Image.open(frame["depth_file_path"])).astype(np.float64) * scale


def scores(depth, true):
    """AbsRel and MSE after scaling by the median of ratios; nearest true pixels where sizes differ."""
    rows, columns = ((np.arange(n) + 0.5) * m / n for n, m in zip(depth.shape, true.shape))
    true = true[np.ix_(rows.astype(int), columns.astype(int))]
    known = (true > 0) & (depth > 0)
    z, true = depth[known], true[known]
    z = z * np.median(true / z)
    return np.mean(np.abs(z / true - 1)), np.mean((z - true) ** 2)


def true_points(document, frame):
    """World points of a true depth map."""
    depth, pose = truth(document, frame), np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])
    fx, fy, cx, cy = (frame.get(key, document.get(key)) for key in ("fl_x", "fl_y", "cx", "cy"))
    half = 0.0 if document.get("pixel_centres") == "integers" else 0.5
    row, column = np.nonzero(depth)
    z = depth[row, column]
    points = [(column + half - cx) / fx * z, (row + half - cy) / fy * z, z]
    return np.stack(points, axis=1) @ pose[:3, :3].T + pose[:3, 3]


def thinned(points, voxel):
    _, first = np.unique(np.floor(points / voxel).astype(np.int64), axis=0, return_index=True)
    return points[first]


def cloud(path):
    """The positions in a binary PLY file whose first properties are x, y, z."""
    data = path.read_bytes()
    header, _, body = data.partition(b"end_header\n")
    kinds = {b"float": "<f4", b"double": "<f8", b"uchar": "u1", b"int": "<i4", b"uint": "<u4", b"ushort": "<u2"}
    lines = [line.split() for line in header.splitlines()]
    fields = [(line[2].decode(), kinds[line[1]]) for line in lines if line[:1] == [b"property"]]
    [count] = [int(line[2]) for line in lines if line[:2] == [b"element", b"vertex"]]
    points = np.frombuffer(body, np.dtype(fields), count)
    return np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=1)


def f_scores(ours, document, frames, median):
    found = []
    for tolerance in TOLERANCES:
        distance = tolerance * median
        true = np.concatenate([thinned(true_points(document, frame), distance / 4) for frame in frames])
        true, thin = thinned(true, distance / 4), thinned(ours, distance / 4)
        accuracy = np.mean(cKDTree(true).query(thin, distance_upper_bound=distance)[0] <= distance)
        complete = np.mean(cKDTree(thin).query(true, distance_upper_bound=distance)[0] <= distance)
        found.append((accuracy, complete, 2 * accuracy * complete / max(accuracy + complete, 1e-9)))
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path, help="a transforms.json with depths")
    parser.add_argument("--mde", type=Path, required=True, help="the program")
    parser.add_argument("-o", "--output", type=Path, required=True, help="runs that are there are not repeated")
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 20, 40, 60])
    parser.add_argument("--sevens", type=int, default=0, metavar="N")
    end = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    own, more = sys.argv[1:end], sys.argv[end + 1 :]
    arguments = parser.parse_args(own)
    document = json.loads(arguments.capture.read_text())
    frames = sorted(document["frames"], key=lambda frame: frame["file_path"])
    for frame in frames:
        for key in ("file_path", "depth_file_path"):
            frame[key] = str(arguments.capture.parent.resolve() / frame[key])
    columns = "".join(f" | accuracy, completeness, F at {100 * tolerance:.0f} %" for tolerance in TOLERANCES)
    print(f"| photographs | used | processor s each | peak MiB | AbsRel, mean | MSE, mean{columns} |")
    print("|---:" * (6 + len(TOLERANCES)) + "|", flush=True)
    of_photograph = {}
    for count in arguments.counts:
        kept, place = frames[:count], arguments.output / f"first-{count}"
        capture = subset(document, kept, arguments.output / f"capture-{count}")
        seconds, record = run([arguments.mde, "dense", capture, "-q", "--force", "-o", place, *more], place)
        by_name = {Path(frame["file_path"]).name: frame for frame in kept}
        of_photograph = {}
        for row in record["photographs"]:
            if row["folder"] and row["reason"] is None:
                frame = by_name[Path(row["photograph"]).name]
                of_photograph[row["photograph"]] = scores(np.load(place / row["folder"] / "depth.npy"), truth(document, frame))
        absrel, mse = np.mean(list(of_photograph.values()), axis=0)
        depths = [truth(document, frame) for frame in kept]
        median = np.median(np.concatenate([depth[depth > 0] for depth in depths]))
        clouds = f_scores(cloud(place / "cloud.ply"), document, kept, median)
        clouds = "".join(" | " + ", ".join(f"{100 * share:.0f}" for share in one) for one in clouds)
        print(
            f"| {len(kept)} | {len(of_photograph)} | {seconds / len(kept):.1f} | {record['peak_memory_bytes'] / 2**20:.0f} "
            f"| {absrel:.4f} | {mse:.4f}{clouds} |",
            flush=True,
        )
    kept = frames[: max(arguments.counts)]
    chosen = np.linspace(0, len(kept) - 1, arguments.sevens).round().astype(int)
    small, large = [], []
    for index in chosen:
        frame = kept[index]
        centre = [np.array(other["transform_matrix"])[:3, 3] for other in kept]
        nearest = np.argsort([np.linalg.norm(at - centre[index]) for at in centre], kind="stable")[:7]
        name = Path(frame["file_path"])
        capture = subset(document, [kept[other] for other in sorted(nearest)], arguments.output / f"seven-{name.stem}")
        place = arguments.output / f"seven-{name.stem}" / "out"
        run([arguments.mde, "refine", name, "--views", capture, "-q", "--force", "-o", place, *more], place)
        small.append(scores(np.load(place / "depth.npy"), truth(document, frame)))
        large.append(of_photograph[name.name])
    if small:
        small, large = np.mean(small, axis=0), np.mean(large, axis=0)
        print(f"\n{len(chosen)} photographs: AbsRel {large[0]:.4f} and MSE {large[1]:.4f} of the whole capture, of sevens {small[0]:.4f} and {small[1]:.4f}")


if __name__ == "__main__":
    main()
