//! Several photographs: arguments of `mde refine --views` and `mde poses`.

use crate::program::args::choice::{UNITS, choice};
use crate::program::args::output::formats;
use crate::program::args::shard::Shard;
use crate::program::args::{
    CameraArgs, ErrorBarArgs, ExportArgs, PriorArgs, RunArgs, SettingsArgs, SizeArgs,
};
use crate::refiner::finish::Unit;
use clap::Args;
use std::path::PathBuf;

/// How several photographs are used.
#[derive(Debug, Args)]
#[command(next_help_heading = "Several photographs")]
pub(crate) struct ViewArgs {
    /// Use at most N photographs, IMAGE included: the best by parallax, overlap and sharpness; default: 8
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=64))]
    pub(crate) max_views: Option<u16>,
    /// Unit of depth and sigma: the prior's, or that of the capture's poses
    #[arg(long, help_heading = "Advanced", value_name = "UNIT", value_parser = choice(UNITS), default_value = "prior")]
    pub(crate) unit: Unit,
}

/// Further photographs of `mde refine`.
#[derive(Debug, Args)]
#[command(next_help_heading = "Several photographs", mut_arg("max_views", |arg| arg.requires("views")), mut_arg("unit", |arg| arg.requires("views")))]
pub(crate) struct SeveralArgs {
    /// Further photographs of the same static scene, or folders of them; their poses are estimated. Or one capture with poses:
    /// transforms.json, a COLMAP model, a TUM sequence
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pub(crate) views: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) views_used: ViewArgs,
    /// Bring the photographs of a burst or video to one scale; they need overlap, not poses
    #[arg(long, help_heading = "Advanced", conflicts_with_all = ["views", "prior_depth"])]
    pub(crate) same_scale: bool,
    /// Only part I of N of the photographs, into a folder that all parts share; the same command without --shard writes the index
    #[arg(long, help_heading = "Advanced", value_name = "I/N", conflicts_with = "views")]
    pub(crate) shard: Option<Shard>,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("export", |export| export.value_parser(formats(true))),
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the capture's name: room-dense for room")),
    mut_arg("force", |force| force.help("Refine photographs again that an earlier run finished")),
    mut_arg("prior_depth", |map| map.hide(true)),
    after_help = "\
Examples:
  mde dense photos -o out/room
  mde dense colmap-project --no-nerf --export colmap-dense -o out/house
  mde dense photos/transforms.json --prior-model fastdepth_224.onnx --unit prior -o out/room

Output: a folder for each photograph, as mde refine writes it, with finished.json; cloud.ply of the points that two photographs confirm,
transforms.json, index.html, run.json; with --export colmap-dense colmap/. The same command continues, and refines only what is new or changed. Without a network the depth
comes from parallax alone, in the unit of the poses; photographs without poses get a unit of their own."
)]
pub(crate) struct DenseArgs {
    /// A folder of photographs, a transforms.json, a COLMAP project (images, sparse/0), or a TUM sequence
    #[arg(value_name = "CAPTURE")]
    pub(crate) capture: PathBuf,
    #[command(flatten)]
    pub(crate) views: ViewArgs,
    /// Only part I of N of the photographs, into a folder that all parts share; the same command without --shard writes the cloud and the index
    #[arg(long, help_heading = "Advanced", value_name = "I/N")]
    pub(crate) shard: Option<Shard>,
    #[command(flatten)]
    pub(crate) prior: PriorArgs,
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) error_bar: ErrorBarArgs,
    #[command(flatten)]
    pub(crate) export: ExportArgs,
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
