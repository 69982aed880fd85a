"""Not a test of pytest: what callers write, for a type checker."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mdenerf


def network(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    return rgb[..., 0] + 1


def progress(stage: str, done: int, total: int) -> None:
    del stage, done, total


def use(photo: NDArray[np.uint8], depth: NDArray[np.float64], folder: Path) -> None:
    refiner = mdenerf.Refiner(network, prior_kind="depth", preset="fast", config={"augmentation": {"predictions": 3}})
    result: mdenerf.Result = refiner.refine(photo, seed=2, progress=progress)
    result = mdenerf.refine(folder / "photo.jpg", "network.onnx", views=[folder / "b.jpg"], intrinsics=np.eye(3))
    result = mdenerf.refine(photo, prior_depth=depth, fov=60.0)
    matrix: NDArray[np.float64] = result.camera.matrix
    sigma: NDArray[np.float32] = result.sigma
    record: dict[str, Any] = result.run
    result = mdenerf.refine(photo, network, scale_from=depth, interval=0.9, calibration=folder / "c.toml", max_memory=4.0)
    lower: NDArray[np.float32] | None = result.lower
    result = mdenerf.refine(photo, prior_depth=folder / "d.png", png_scale=5000.0, intrinsics=np.eye(3), keep_field=True)
    field: bytes | None = result.field
    scales: list[mdenerf.SameScale] = refiner.same_scale([photo, photo], fov=60.0)
    result = refiner.refine(photo, same_scale=scales[0])
    for each in mdenerf.refine_many([photo], network, same_scale=True, predictions=1):
        result = each
    for one in refiner.refine_many(folder, return_exceptions=True):
        failed: bool = isinstance(one, mdenerf.Error)
        del failed
    scene: mdenerf.Scene = mdenerf.dense([photo, folder / "b.jpg"], network, unit="prior", preset="multi-view")
    scene = mdenerf.dense(folder, poses=np.zeros((2, 4, 4)))
    scene = refiner.dense(folder / "transforms.json", keep_field=True)
    pose: NDArray[np.float64] | None = scene.poses[0]
    for each in scene:
        result = each
    some: list[mdenerf.Result] = scene[1:]
    written: Path = scene.save(folder / "scene", export="ply")
    del pose, some, written
    saved: Path = result.save(folder / "out", force=True, export=["ply"])
    fit: mdenerf.AffineFit = mdenerf.affine_wls(depth, depth, sigma)
    score: dict[str, Any] = mdenerf.metrics.score(result.depth, depth, sigma)
    table: NDArray[np.float64] = mdenerf.metrics.reliability(depth, sigma)
    del field, lower, matrix, record, saved, fit, score, table
