"""Shows a result in rerun's viewer: ``python log_to_rerun.py photo.jpg network.onnx`` (``pip install mdenerf rerun-sdk``)."""

from __future__ import annotations

import argparse

import mdenerf
import numpy as np
import rerun as rr


def log(result: mdenerf.Result, name: str = "photograph") -> None:
    """Logs photograph, depth, sigma, prior and points under ``name``; the world is the frame of the camera."""
    camera = result.camera
    size = [camera.width, camera.height]
    rr.log(name, rr.ViewCoordinates.RDF, static=True)
    rr.log(f"{name}/camera", rr.Pinhole(image_from_camera=camera.matrix, resolution=size))
    rr.log(f"{name}/camera/image", rr.Image(result.image))
    # Missing pixels are 0 in every map of rerun.
    sigma = np.where(np.isfinite(result.sigma), result.sigma, 0.0).astype(np.float32)
    for part, depth in (("depth", result.depth), ("sigma", sigma), ("prior", result.prior)):
        rr.log(f"{name}/camera/{part}", rr.DepthImage(depth, meter=1.0))
    seen = (result.depth > 0) & np.isfinite(result.sigma)
    points, colours = camera.points(result.depth)[seen], result.image[seen]
    rr.log(f"{name}/points", rr.Points3D(points, colors=colours))


def main() -> None:
    parser = argparse.ArgumentParser(description="Refines the depth of a photograph and shows it in rerun's viewer.")
    parser.add_argument("photograph")
    parser.add_argument("model", help="a depth network, .onnx")
    parser.add_argument("--save", metavar="FILE.rrd", help="write a recording instead of opening the viewer")
    arguments = parser.parse_args()
    rr.init("mdenerf", spawn=arguments.save is None)
    if arguments.save is not None:
        rr.save(arguments.save)
    log(mdenerf.refine(arguments.photograph, arguments.model))


if __name__ == "__main__":
    main()
