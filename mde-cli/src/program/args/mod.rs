//! The command line.

mod evaluation;
mod groups;
mod values;

pub(crate) use evaluation::*;
pub(crate) use groups::*;

use crate::config::Preset;
use crate::program::args::values::{KINDS, choice, formats, size, triple};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, CommandFactory, Id, Parser, Subcommand};
use mde_eval::data::Shard;
use mde_prior::DepthKind;
use std::path::{Path, PathBuf};

/// Refine the monocular depth of a photograph, with a standard deviation per pixel
#[derive(Debug, Parser)]
#[command(name = "mde", version, after_help = include_str!("help/mde.txt").trim_end(), max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The command line; the help of each command ends with what few need.
pub(crate) fn command() -> clap::Command {
    Cli::command().mut_subcommands(|command| {
        let rare = command.get_arguments().filter(|argument| argument.get_help_heading() == Some("Advanced"));
        let rare: Vec<Id> = rare.map(|argument| argument.get_id().clone()).collect();
        // Headings come in the order of their first arguments, and a mutated one becomes the last.
        rare.into_iter().fold(command, |command, id| command.mut_arg(id, |argument| argument))
    })
}

/// The error of the arguments; where IMAGE is missing, `--views` has taken it.
pub(crate) fn explained(mut error: clap::Error) -> clap::Error {
    if error.kind() == ErrorKind::MissingRequiredArgument && std::env::args().any(|one| one == "--views") {
        let tip = "put IMAGE first: --views takes all paths that follow it";
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Refine a procedural room with exact depth from photographs without poses; needs no input
    Demo(DemoArgs),
    /// Depth with an error bar: of one photograph, of several of one place, or of each in a folder
    Refine(Box<RefineArgs>),
    /// Depth of every photograph of a capture, with poses or without, and one point cloud
    Dense(Box<DenseArgs>),
    /// Estimate the poses of photographs and write a transforms.json
    Poses(Box<PosesArgs>),
    /// Write the synthetic views of an image, for inspection
    Warp(Box<WarpArgs>),
    /// Render a field saved by `mde refine --export field`
    Render(Box<RenderArgs>),
    /// Score methods on the scenes of a data set
    Eval(Box<EvalArgs>),
    /// Score the depth maps of any program
    Score(Box<ScoreMapsArgs>),
    /// Run an ablation: one change of the settings per row
    Ablate(Box<AblateArgs>),
    /// Calibrate the error bars of mde refine on scenes with known depth
    Calibrate(Box<CalibrateArgs>),
    /// Print a preset as TOML
    #[command(after_help = include_str!("help/config.txt").trim_end())]
    Config {
        /// Preset
        #[arg(long, value_name = "NAME", default_value = "default")]
        preset: Preset,
    },
    /// Time the field's fit and rendering on this machine, by stage
    Bench(BenchArgs),
    /// Write report.html again from the files of a folder
    #[command(after_help = include_str!("help/report.txt").trim_end())]
    Report {
        /// The folder of a run or an evaluation
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Check this machine and a model
    Doctor(DoctorArgs),
    /// Print shell completions
    #[command(after_help = include_str!("help/completions.txt").trim_end())]
    Completions {
        /// Shell
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Print a manual page
    #[command(after_help = include_str!("help/man.txt").trim_end())]
    Man {
        /// Manual page of this subcommand instead of the program's
        #[arg(value_name = "COMMAND")]
        command: Option<String>,
    },
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default mde-demo in the working folder")),
    after_help = include_str!("help/demo.txt").trim_end()
)]
pub(crate) struct DemoArgs {
    /// Size of the room's image, pixels
    #[arg(long, value_name = "WxH", default_value = "480x360", value_parser = size)]
    pub(crate) size: [usize; 2],
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) results: ResultArgs,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("max_views", |arg| arg.requires("views")),
    mut_arg("unit", |arg| arg.requires("views")),
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the input's name: room-depth for room.jpg. Many photographs need one")),
    after_help = include_str!("help/refine.txt").trim_end()
)]
pub(crate) struct RefineArgs {
    /// The photograph: JPEG, PNG, TIFF, BMP or WebP. Or many, each refined alone: photographs, patterns ('holiday/*.jpg'), folders, lists
    /// (.txt, one name or pattern per line), or - for names from standard input
    #[arg(value_name = "IMAGE")]
    pub(crate) image: PathBuf,
    /// More photographs, folders and lists
    #[arg(value_name = "MORE")]
    pub(crate) more: Vec<PathBuf>,
    /// After IMAGE: further photographs of the same still scene (files, folders, patterns), whose poses are estimated. Or one capture with
    /// poses: transforms.json, a COLMAP model, a TUM sequence
    #[arg(long, help_heading = "Several photographs", value_name = "PATH", num_args = 1..)]
    pub(crate) views: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) common: RefinementArgs,
    /// Bring the photographs of a burst or video to one scale; they need overlap, not poses
    #[arg(long, help_heading = "Advanced", conflicts_with_all = ["views", "prior_depth"])]
    pub(crate) same_scale: bool,
    /// Only part I of N of the photographs, into a folder that all parts share; the same command without --shard writes the index
    #[arg(long, help_heading = "Advanced", value_name = "I/N", conflicts_with = "views")]
    pub(crate) shard: Option<Shard>,
    /// Depths known at some pixels, which give the result its scale: a CSV file of column, row, depth and if known its standard
    /// deviation, in pixels of the photograph and metres, or the folder of a COLMAP model of this photograph
    #[arg(long, help_heading = "Prior", value_name = "FILE|DIR", conflicts_with = "unit")]
    pub(crate) scale_from: Option<PathBuf>,
    /// Ground-truth depth of the image's size, metres (0: missing), to score prior and refined depth
    #[arg(long, help_heading = "Truth", value_name = "FILE")]
    pub(crate) gt: Option<PathBuf>,
}

impl RefineArgs {
    /// Everything that the command names to be refined.
    pub(crate) fn photographs(&self) -> Vec<&Path> {
        std::iter::once(&self.image).chain(&self.more).map(PathBuf::as_path).collect()
    }
}

#[derive(Debug, Args)]
#[command(
    mut_arg("export", |export| export.value_parser(formats(true))),
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the capture's name: room-dense for room")),
    mut_arg("force", |force| force.help("Refine photographs again that an earlier run finished")),
    mut_arg("prior_depth", |map| map.hide(true)),
    after_help = include_str!("help/dense.txt").trim_end()
)]
pub(crate) struct DenseArgs {
    /// A folder of photographs, a transforms.json, a COLMAP project (images, sparse/0), or a TUM sequence
    #[arg(value_name = "CAPTURE")]
    pub(crate) capture: PathBuf,
    #[command(flatten)]
    pub(crate) common: RefinementArgs,
    /// Only part I of N of the photographs, into a folder that all parts share; the same command without --shard writes the cloud and the index
    #[arg(long, help_heading = "Advanced", value_name = "I/N")]
    pub(crate) shard: Option<Shard>,
}

#[derive(Debug, Args)]
#[command(
    after_help = include_str!("help/poses.txt").trim_end(),
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

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the input's name: room-views for room.jpg")),
    after_help = include_str!("help/warp.txt").trim_end()
)]
pub(crate) struct WarpArgs {
    /// The photograph: JPEG, PNG, TIFF, BMP or WebP
    #[arg(value_name = "IMAGE")]
    pub(crate) image: PathBuf,
    #[command(flatten)]
    pub(crate) prior: PriorArgs,
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) settings: PresetArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the field's name: field-render for field.safetensors")),
    after_help = include_str!("help/render.txt").trim_end()
)]
pub(crate) struct RenderArgs {
    /// The field saved by `mde refine --export field`
    #[arg(long, value_name = "FIELD.safetensors")]
    pub(crate) field: PathBuf,
    /// Size of the images, pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: [usize; 2],
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
    /// Number of views on a circle about the original camera, all looking at the middle of the scene
    #[arg(long, help_heading = "Path", value_name = "N", conflicts_with = "translate", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) orbit: Option<u16>,
    /// Radius of the circle, as a fraction of the median depth
    #[arg(long, help_heading = "Path", value_name = "X", default_value_t = 0.03)]
    #[arg(requires = "orbit", conflicts_with = "translate")]
    pub(crate) radius: f64,
    /// One view from a camera moved by X,Y,Z, in the prior's unit (x right, y down, z forward)
    #[arg(long, help_heading = "Path", value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub(crate) translate: Option<[f64; 3]>,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
#[command(after_help = include_str!("help/bench.txt").trim_end())]
pub(crate) struct BenchArgs {
    /// Seconds per stage
    #[arg(long, default_value_t = 0.5, value_name = "SECONDS")]
    pub(crate) seconds: f64,
    /// Threads of the parallel stages; all processors otherwise
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    /// One JSON object instead of the table
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = include_str!("help/doctor.txt").trim_end())]
pub(crate) struct DoctorArgs {
    /// A monocular depth network to check
    #[arg(long, value_name = "MODEL.onnx")]
    pub(crate) prior_model: Option<PathBuf>,
    /// Input and output format of the model; else MODEL.toml beside MODEL.onnx, else recognised by its folder, its graph or its name
    #[arg(long, value_name = "NAME", requires = "prior_model")]
    pub(crate) model_profile: Option<String>,
    /// Kind of the model's values; by default that of the profile
    #[arg(long, value_name = "KIND", value_parser = choice(KINDS), requires = "prior_model")]
    pub(crate) prior_kind: Option<DepthKind>,
    /// ONNX Runtime's library, timed beside tract; else ORT_DYLIB_PATH, else beside this program, else in the active Python
    #[arg(long, value_name = "LIBRARY", requires = "prior_model")]
    pub(crate) runtime: Option<String>,
}

#[cfg(test)]
mod tests;
