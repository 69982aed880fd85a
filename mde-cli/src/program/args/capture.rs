//! Several photographs: arguments of `mde refine --views` and `mde poses`.

use crate::program::args::choice::{UNITS, choice};
use crate::program::args::shard::Shard;
use crate::program::args::{CameraArgs, PriorArgs, RunArgs, SizeArgs};
use crate::refiner::finish::Unit;
use clap::Args;
use std::path::PathBuf;

/// Further photographs of `mde refine`.
#[derive(Debug, Args)]
#[command(next_help_heading = "Several photographs")]
pub(crate) struct SeveralArgs {
    /// Further photographs of the same static scene, or folders of them; their poses are estimated. Or one capture with poses:
    /// transforms.json, a COLMAP model, a TUM sequence
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pub(crate) views: Vec<PathBuf>,
    /// Use at most N photographs, IMAGE included: the best by parallax, overlap and sharpness; default: 8
    #[arg(long, value_name = "N", requires = "views", value_parser = clap::value_parser!(u16).range(2..=64))]
    pub(crate) max_views: Option<u16>,
    /// Unit of depth and sigma: the prior's, or that of the capture's poses
    #[arg(long, help_heading = "Advanced", value_name = "UNIT", value_parser = choice(UNITS), default_value = "prior", requires = "views")]
    pub(crate) unit: Unit,
    /// Refine every photograph: a folder for each, transforms.json, and cloud.ply of the points that two photographs confirm
    #[arg(long, requires = "views", conflicts_with_all = ["prior_depth", "gt"])]
    pub(crate) all: bool,
    /// Bring the photographs of a burst or video to one scale; they need overlap, not poses
    #[arg(long, help_heading = "Advanced", conflicts_with_all = ["views", "prior_depth"])]
    pub(crate) same_scale: bool,
    /// Only part I of N of the photographs, into a folder that all parts share; the same command without --shard writes the index
    #[arg(long, help_heading = "Advanced", value_name = "I/N", conflicts_with = "views")]
    pub(crate) shard: Option<Shard>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "\
Examples:
  mde poses photos --prior-model fastdepth_224.onnx -o photos/transforms.json
  mde refine photos/0.jpg --views photos/transforms.json --prior-model fastdepth_224.onnx -o out/room

The world is the frame of the first photograph's camera, in the unit of its prior. Photographs that do not fit are left out, with the
reason. Photographs are resized to 1024 pixels on the longer side, or to --max-size; the intrinsics are for their full size.",
    mut_arg("output", |output| output.value_name("FILE.json").help("File to write, as nerfstudio has it; default: transforms.json")),
    mut_arg("force", |force| force.help("Replace the file"))
)]
pub(crate) struct PosesArgs {
    /// Photographs of one static scene, or folders of them
    #[arg(value_name = "PHOTO", required = true)]
    pub(crate) photographs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) prior: PriorArgs,
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}
