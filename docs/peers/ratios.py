"""Ratios of two methods of an evaluation, with intervals over places.

    python3 ratios.py out/posed multi-view consensus

Prints for each metric the geometric mean over the scenes of the first method's value divided by the second's, its 95 %
interval over resampled places (all scenes of a place together), the extremes, and the mean of each place. A third name is
another evaluation's folder, which has the second method. Reads `scenes.csv`; needs Python alone.
"""

import argparse
import csv
import math
import random
from pathlib import Path

RESAMPLES = 20_000
METRICS = ("mse", "abs_rel", "d3r", "f1_max@0.25m_r1")


def rows(folder, method):
    """The row of each scene that has a method."""
    path = Path(folder) / "scenes.csv"
    try:
        with path.open(newline="") as file:
            found = {row["scene"]: row for row in csv.DictReader(file) if row["method"] == method}
    except OSError as error:
        raise SystemExit(f"{path}: {error.strerror}; give the folder that mde eval wrote") from None
    if not found:
        raise SystemExit(f"{path}: no method {method}")
    return found


def logs(first, second, metric):
    """Logarithms of the ratios by place."""
    by_place = {}
    for scene in first.keys() & second.keys():
        values = [float(row[metric] or "nan") for row in (first[scene], second[scene])]
        if all(value > 0 for value in values):
            by_place.setdefault(first[scene]["place"], []).append(math.log(values[0] / values[1]))
    return dict(sorted(by_place.items()))


def mean(groups):
    return sum(map(sum, groups)) / sum(map(len, groups))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", help="an evaluation's output")
    parser.add_argument("method")
    parser.add_argument("reference", help="the method to divide by")
    parser.add_argument("other", nargs="?", help="the output that has the reference; the same by default")
    parser.add_argument("--metrics", default=",".join(METRICS), help="columns of scenes.csv")
    arguments = parser.parse_args()
    first = rows(arguments.folder, arguments.method)
    second = rows(arguments.other or arguments.folder, arguments.reference)
    for metric in arguments.metrics.split(","):
        places = logs(first, second, metric)
        if not places:
            raise SystemExit(f"{metric}: no scene has it for both methods")
        rng = random.Random(0)
        names = list(places)
        resampled = sorted(
            mean([places[rng.choice(names)] for _ in names]) for _ in range(RESAMPLES)
        )
        low, high = (math.exp(resampled[int(share * (RESAMPLES - 1))]) for share in (0.025, 0.975))
        ratios = [math.exp(value) for values in places.values() for value in values]
        by_place = ", ".join(f"{name} {math.exp(mean([values])):.2f}" for name, values in places.items())
        print(
            f"{metric}: {math.exp(mean(places.values())):.3f} [{low:.2f}, {high:.2f}], "
            f"{len(ratios)} scenes {min(ratios):.2f} to {max(ratios):.2f}; {by_place}"
        )


if __name__ == "__main__":
    main()
