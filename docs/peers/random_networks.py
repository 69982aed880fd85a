"""Published architectures with random weights as ONNX files, and what the program makes of them.

    apt-get install python3-torch python3-venv libopenblas0
    /usr/bin/python3 -m venv --system-site-packages env && env/bin/pip install transformers==4.46.3 onnxruntime 'numpy<2'
    env/bin/python docs/peers/random_networks.py nets --mde target/release/mde --photograph room.jpg

Weights are not at hand, but layers and graphs do not depend on them: these are Transformers' own networks at the sizes of the published
ones, exported as `optimum-cli` does, with `config.json` and `preprocessor_config.json` beside them. Each is tried with `mde doctor`, which
must not say that it works, and refined with one prediction by tract and by ONNX Runtime, whose maps are compared. The result is a table in
Markdown. The larger networks take 8 GB of memory and minutes. Not part of the build and of no test.
"""

import argparse
import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import onnxruntime
import torch
import transformers
from transformers import BeitConfig, Dinov2Config

# Gain of the random weights, below 1 so that no activation overflows.
GAIN = 0.8
IMAGENET = {"image_mean": [0.485, 0.456, 0.406], "image_std": [0.229, 0.224, 0.225]}
HALF = {"image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5]}


def depth_anything(metric=None):
    # get_dpt_config of models/depth_anything/convert_depth_anything_to_hf.py, "v2" and "small"; the backbone is
    # facebook/dinov2-small: DINOv2's ViT-S/14 (dinov2/models/vision_transformer.py, vit_small; img_size 518 of its configs).
    backbone = Dinov2Config(
        hidden_size=384,
        num_hidden_layers=12,
        num_attention_heads=6,
        mlp_ratio=4,
        image_size=518,
        patch_size=14,
        out_indices=[3, 6, 9, 12],
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=384,
        patch_size=14,
        fusion_hidden_size=64,
        neck_hidden_sizes=[48, 96, 192, 384],
        depth_estimation_type="metric" if metric else "relative",
        max_depth=metric,
    )
    # The processor of the same script.
    size = {"size": {"height": 518, "width": 518}, "keep_aspect_ratio": True, "ensure_multiple_of": 14, "resample": 3}
    return transformers.DepthAnythingForDepthEstimation(config), size | IMAGENET, (70, 98)


def dpt_hybrid():
    # get_dpt_config of models/dpt/convert_dpt_hybrid_to_pytorch.py, "midas"; the rest are DPTConfig's defaults for a hybrid.
    config = transformers.DPTConfig(
        is_hybrid=True,
        hidden_size=768,
        reassemble_factors=[1, 1, 1, 0.5],
        neck_hidden_sizes=[256, 512, 768, 768],
        patch_size=16,
        use_batch_norm_in_fusion_residual=False,
        readout_type="project",
    )
    size = {"size": 384, "keep_aspect_ratio": False, "ensure_multiple_of": 1, "resample": 2}
    return transformers.DPTForDepthEstimation(config), size | HALF, (384, 384)


def dpt_large():
    # get_dpt_config of models/dpt/convert_dpt_to_pytorch.py, "large".
    config = transformers.DPTConfig(
        hidden_size=1024,
        intermediate_size=4096,
        num_hidden_layers=24,
        num_attention_heads=16,
        backbone_out_indices=[5, 11, 17, 23],
        neck_hidden_sizes=[256, 512, 1024, 1024],
    )
    size = {"size": 384, "keep_aspect_ratio": False, "ensure_multiple_of": 1, "resample": 2}
    return transformers.DPTForDepthEstimation(config), size | HALF, (384, 384)


def zoedepth():
    # get_zoedepth_config of models/zoedepth/convert_zoedepth_to_hf.py, "ZoeD_NK".
    backbone = BeitConfig(
        image_size=384,
        num_hidden_layers=24,
        hidden_size=1024,
        intermediate_size=4096,
        num_attention_heads=16,
        use_relative_position_bias=True,
        reshape_hidden_states=False,
        out_features=["stage6", "stage12", "stage18", "stage24"],
    )
    config = transformers.ZoeDepthConfig(
        backbone_config=backbone,
        neck_hidden_sizes=[256, 512, 1024, 1024],
        bin_centers_type="softplus",
        bin_configurations=[
            {"name": "nyu", "n_bins": 64, "min_depth": 1e-3, "max_depth": 10.0},
            {"name": "kitti", "n_bins": 64, "min_depth": 1e-3, "max_depth": 80.0},
        ],
        num_patch_transformer_layers=4,
        patch_transformer_hidden_size=128,
        patch_transformer_intermediate_size=1024,
        patch_transformer_num_attention_heads=4,
    )
    # Defaults of ZoeDepthImageProcessor.
    size = {"size": {"height": 384, "width": 512}, "keep_aspect_ratio": True, "ensure_multiple_of": 32, "resample": 2}
    return transformers.ZoeDepthForDepthEstimation(config), size | HALF, (96, 128)


def glpn():
    # convert_glpn_checkpoint of models/glpn/convert_glpn_to_pytorch.py.
    config = transformers.GLPNConfig(hidden_sizes=[64, 128, 320, 512], decoder_hidden_size=64, depths=[3, 8, 27, 3])
    return transformers.GLPNForDepthEstimation(config), {"size_divisor": 32, "resample": 2}, (64, 96)


NETWORKS = {
    "depth-anything-v2-small": depth_anything,
    "depth-anything-v2-small-metric": lambda: depth_anything(20),
    "dpt-hybrid": dpt_hybrid,
    "dpt-large": dpt_large,
    "zoedepth": zoedepth,
    "glpn": glpn,
}


class Depth(torch.nn.Module):
    """The network with its depth alone, as `optimum-cli` exports it."""

    def __init__(self, network):
        super().__init__()
        self.network = network

    def forward(self, pixel_values):
        return self.network(pixel_values).predicted_depth


def export(name, folder):
    """Writes the network and the files that a hub has beside it; returns its number of parameters."""
    torch.manual_seed(0)
    network, preprocessor, (height, width) = NETWORKS[name]()
    network.eval()
    # With the weights that Transformers draws, of a deviation of .02, depths differ by little more than a float's resolution.
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.dim() > 1:
                torch.nn.init.kaiming_normal_(parameter).mul_(GAIN)
    folder.mkdir(parents=True, exist_ok=True)
    network.config.save_pretrained(folder)
    document = {"do_normalize": "image_mean" in preprocessor, **preprocessor}
    (folder / "preprocessor_config.json").write_text(json.dumps(document))
    sides = {0: "batch", 2: "height", 3: "width"}
    with torch.no_grad():
        torch.onnx.export(
            Depth(network),
            torch.rand(1, 3, height, width),
            str(folder / "model.onnx"),
            opset_version=16,
            input_names=["pixel_values"],
            output_names=["predicted_depth"],
            dynamic_axes={"pixel_values": sides, "predicted_depth": {0: "batch", 1: "height", 2: "width"}},
        )
    return sum(parameter.numel() for parameter in network.parameters())


def last_line(text):
    return text.strip().splitlines()[-1].split(".onnx: ")[-1] if text.strip() else "nothing was said"


def doctor(mde, model, library):
    """The profile's size or why there is none, the verdict, and seconds of a prediction by each runtime."""
    command = [mde, "doctor", "--prior-model", model, "--runtime", library]
    run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "COLUMNS": "100000"})
    profile = re.search(r"^network .*: ([0-9]+x[0-9]+), ([a-z]+)$", run.stdout, re.M)
    seconds = re.findall(r"^runtime .*?: ([0-9.]+) s a prediction", run.stdout, re.M)
    if run.returncode == 0:
        verdict = "works"
    else:
        correlation = re.search(r"mean correlation (-?[0-9.]+)", run.stderr)
        name = "exchanged" if "exchanged" in run.stderr else "not beyond chance"
        verdict = f"{name} ({correlation[1]})" if correlation else f"fails: {last_line(run.stderr)[:120]}"
    if profile is None:
        return "no", verdict, seconds
    return f"{profile[2]}, {profile[1]}", verdict, seconds


def refine(mde, model, photograph, output, more):
    """The network's own values, negative ones 0, or the error of `mde refine`."""
    command = [mde, "refine", photograph, "--prior-model", model, "--predictions", "1", "--fov", "60", "--force", "-o", output]
    run = subprocess.run([*command, "--prior-kind", "metric", *more], capture_output=True, text=True)
    return np.load(output / "prior.npy") if run.returncode == 0 else last_line(run.stderr)


def compared(maps):
    """The largest difference of the two runtimes' values over their range, or which of them fails."""
    failed = [name for name, depth in zip(("tract", "ONNX Runtime"), maps) if isinstance(depth, str)]
    if failed:
        return f"{' and '.join(failed)} failed"
    one, other = maps
    return f"{np.abs(one - other).max() / np.ptp(other):.1e}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="networks go to OUTPUT/NAME/model.onnx; one that is there is not exported again")
    parser.add_argument("--mde", type=Path, required=True, help="the program")
    parser.add_argument("--photograph", type=Path, required=True)
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=list(NETWORKS))
    arguments = parser.parse_args()
    [library] = Path(onnxruntime.__file__).parent.glob("capi/libonnxruntime.so*")
    print("| Network | Parameters | Profile | `mde doctor` | tract, ONNX Runtime | Largest difference |")
    print("|---|---|---|---|---|---|", flush=True)
    for name in arguments.networks:
        folder = arguments.output / name
        model, count = folder / "model.onnx", folder / "parameters"
        if not count.is_file():
            try:
                count.write_text(str(export(name, folder)))
            except Exception as error:  # whatever the exporter says
                print(f"| {name} | not exported: {last_line(str(error))} | | | | |", flush=True)
                continue
        if name == "glpn":
            # Its input has the photograph's own size, which a hub's files do not say.
            (folder / "model.toml").write_text("width = 640\nheight = 480\noutput = 'metric'\n")
        profile, verdict, seconds = doctor(arguments.mde, model, library)
        if model.with_suffix(".toml").is_file():
            profile += ", by a TOML file"
        runtimes = (["--runtime", "tract"], ["--runtime", library])
        outputs = [folder / "tract", folder / "onnxruntime"]
        maps = [refine(arguments.mde, model, arguments.photograph, *where) for where in zip(outputs, runtimes)]
        millions = f"{int(count.read_text()) / 1e6:.0f} M"
        times = " s, ".join(seconds) + " s" if seconds else "-"
        print(f"| {name} | {millions} | {profile} | {verdict} | {times} | {compared(maps)} |", flush=True)


if __name__ == "__main__":
    main()
