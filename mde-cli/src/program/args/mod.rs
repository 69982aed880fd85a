//! The command line.

mod capture;
mod choice;
mod evaluation;
mod output;
mod prior;
pub(crate) mod shard;
mod tools;

pub(crate) use capture::{DenseArgs, PosesArgs, SeveralArgs, ViewArgs};
pub(crate) use evaluation::{
    AblateArgs, CalibrateArgs, CaptureArgs, CropName, DataArgs, EvalArgs, EvalPriorArgs, EvaluationArgs,
    Grid, PixelArgs, ScoreMapsArgs, Simulated, Withheld,
};
pub(crate) use output::{ExportArgs, RunArgs};
pub(crate) use prior::{NetworkArgs, PriorArgs};
pub(crate) use tools::{CompletionsArgs, DoctorArgs, ManArgs};

use crate::config::Preset;
use crate::program::args::choice::{PRESETS, choice};
use crate::refiner::plan::limit::MemoryLimit;
use crate::scene::size::Sizes;
use clap::{Args, CommandFactory, Id, Parser, Subcommand};
use mde_prior::augment::Predictions;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  mde demo -o out/demo
  mde refine room.jpg --prior-model fastdepth_224.onnx -o out/room
  mde refine room.jpg --views left.jpg right.jpg -o out/room
  mde dense photos -o out/rooms
  mde poses room --prior-model fastdepth_224.onnx -o room/transforms.json
  mde refine room.png --prior-depth depth.npy --fov 62 --preset fast -o out/room
  mde refine room.png --prior-depth disparity.pfm --prior-kind disparity --gt truth.png -o out/room
  mde config --preset paper > my.toml && mde refine room.jpg --prior-model dpt_large.onnx --config my.toml -o out/room

Exit codes:
  0    done
  1    failed; one line on stderr names the cause and the remedy
  2    wrong usage
  3    some photographs or scenes failed; the others are written
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP or SIGQUIT); only what mde dense, many photographs and evaluations have finished is kept";

/// Refine the monocular depth of a photograph, with a standard deviation per pixel
#[derive(Debug, Parser)]
#[command(name = "mde", version, after_help = EXAMPLES, max_term_width = 110)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Heading of what few need.
const RARE: &str = "Advanced";

/// The command line; the help of each command ends with what few need.
pub(crate) fn command() -> clap::Command {
    Cli::command().mut_subcommands(|command| {
        let rare = command.get_arguments().filter(|argument| argument.get_help_heading() == Some(RARE));
        let rare: Vec<Id> = rare.map(|argument| argument.get_id().clone()).collect();
        // Headings come in the order of their first arguments, and a mutated one becomes the last.
        rare.into_iter().fold(command, |command, id| command.mut_arg(id, |argument| argument))
    })
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Refine a procedural room with exact depth from photographs without poses; needs no input
    Demo(DemoArgs),
    /// Refine the monocular depth of an image
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
    Config(ConfigArgs),
    /// Time the field's fit and rendering on this machine, by stage
    Bench(BenchArgs),
    /// Write report.html again from the files of a folder
    Report(ReportArgs),
    /// Check this machine and a model
    Doctor(DoctorArgs),
    /// Print shell completions
    Completions(CompletionsArgs),
    /// Print a manual page
    Man(ManArgs),
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default mde-demo in the working folder")),
    after_help = "\
Examples:
  mde demo -o out/demo
  mde demo -o out/demo --preset fast --size 160x120 --seed 3 --force

Six photographs without poses, each with the depth of a simulated network; one of them is withheld, to be compared with what the
field renders. Other presets refine one photograph with a simulated depth map; their training steps are scaled with the
number of pixels (all at 640x480, at least 500), unless --config is given.

Output: that of mde refine, and photographs/, from which it can be repeated:
  mde refine out/demo/photographs/0.png --views out/demo/photographs --prior-depth out/demo/prior.npy --fov 62 -o out/again"
)]
pub(crate) struct DemoArgs {
    /// Size of the room's image, pixels
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = size)]
    pub(crate) size: [usize; 2],
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) error_bar: ErrorBarArgs,
    #[command(flatten)]
    pub(crate) export: ExportArgs,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the input's name: room-depth for room.jpg. Many photographs need one")),
    after_help = "\
Examples:
  mde refine room.jpg --prior-model fastdepth_224.onnx
  mde refine room.jpg --prior-model net.onnx --model-profile depth-anything-v2 -o out/room
  mde refine holiday --prior-model fastdepth_224.onnx -o out/holiday
  mde refine room.png --prior-depth depth.png --png-scale 5000 --intrinsics K.txt -o out/room
  mde refine room.png --prior-depth depth.exr --fx 520,521 --cx 319.5 --cy 239.5 --gt truth.npy -o out/room

Output: depth.npy and sigma.npy (f32 [height, width], the prior's unit; missing: 0 and inf), prior.npy, depth.png
(16 bit, millimetres), confidence.png, image.png, preview.png, config.toml (all settings), run.json (all measurements),
report.html (all results on one page); with --gt gt.npy; with --interval lower.npy and upper.npy; with --export cloud.ply, mesh.glb,
depth.exr, colmap/, transforms.json, sigma/. With many photographs one such folder for each, with thumbnail.png and finished.json, and index.html,
index.csv, index.json; the same command continues, and refines only what is new or changed."
)]
pub(crate) struct RefineArgs {
    /// The photograph: JPEG, PNG, TIFF, BMP or WebP. Or many, each refined alone: photographs, patterns ('holiday/*.jpg'), folders, lists
    /// (.txt, one name or pattern per line), or - for names from standard input
    #[arg(value_name = "IMAGE")]
    pub(crate) image: PathBuf,
    /// More photographs, folders and lists
    #[arg(value_name = "MORE")]
    pub(crate) more: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) several: SeveralArgs,
    #[command(flatten)]
    pub(crate) prior: PriorArgs,
    /// Depths known at some pixels, which give the result its scale: a CSV file of column, row, depth and if known its standard
    /// deviation, in pixels of the photograph and metres, or the folder of a COLMAP model of this photograph
    #[arg(long, help_heading = "Prior", value_name = "FILE|DIR", conflicts_with = "unit")]
    pub(crate) scale_from: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    #[command(flatten)]
    pub(crate) size: SizeArgs,
    #[command(flatten)]
    pub(crate) truth: TruthArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
    #[command(flatten)]
    pub(crate) error_bar: ErrorBarArgs,
    #[command(flatten)]
    pub(crate) export: ExportArgs,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the input's name: room-views for room.jpg")),
    after_help = "\
Example:
  mde warp room.jpg --prior-model fastdepth_224.onnx -o out/views

Output: view_00.png (the original), view_01.png ... with mask_01.png (white: used for training) and depth_01.npy
(0: missing), poses.json, contact.png (masked pixels in red), config.toml, run.json."
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
    after_help = "\
Examples:
  mde render --field out/room/field.safetensors --size 640x480 --fov 62 -o out/view
  mde render --field out/room/field.safetensors --size 320x240 --fov 62 --orbit 24 -o out/orbit

Output per view: colour.png, depth.npy, sigma.npy (missing: 0 and inf), depth.png; numbered with --orbit; run.json."
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
    #[command(flatten)]
    pub(crate) path: PathArgs,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Path")]
pub(crate) struct PathArgs {
    /// Number of views on a circle about the original camera, all looking at the middle of the scene
    #[arg(long, value_name = "N", conflicts_with = "translate", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) orbit: Option<u16>,
    /// Radius of the circle, as a fraction of the median depth
    #[arg(long, value_name = "X", requires = "orbit", conflicts_with = "translate", default_value_t = 0.03)]
    pub(crate) radius: f64,
    /// One view from a camera moved by X,Y,Z, in the prior's unit (x right, y down, z forward)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub(crate) translate: Option<[f64; 3]>,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mde config --preset paper > my.toml")]
pub(crate) struct ConfigArgs {
    /// Preset
    #[arg(long, value_name = "NAME", value_parser = choice(PRESETS), default_value = "default")]
    pub(crate) preset: Preset,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde bench
  mde bench --field hash-8x4 --threads 2 --json

Samples, matrix operations and bytes per second, beside the peak of processor and memory measured in the same run. The stages run
on one thread; the whole step and the render run on one thread and on all.")]
pub(crate) struct BenchArgs {
    /// Only this field: hash-12x2, hash-8x4 (default and fast) or mlp-4x128
    #[arg(long, value_name = "NAME")]
    pub(crate) field: Option<String>,
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
#[command(after_help = "\
Example:
  mde report out/room

The page is made from the files of mde refine, demo, eval or ablate. It needs no network.")]
pub(crate) struct ReportArgs {
    /// The folder of a run or an evaluation
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
}

// Clap accepts an argument whose required argument conflicts with another, so such conflicts are listed too.

/// The pinhole camera.
#[derive(Debug, Args)]
#[command(next_help_heading = "Camera (without: EXIF, else 60 degrees)")]
pub(crate) struct CameraArgs {
    /// Intrinsics: a 3x3 matrix as text, or JSON with fx, fy, cx, cy
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fx", "fov"])]
    pub(crate) intrinsics: Option<PathBuf>,
    /// Focal length, pixels, horizontal and vertical
    #[arg(long, value_name = "PX[,PX]", allow_hyphen_values = true, value_parser = focal, conflicts_with = "fov")]
    pub(crate) fx: Option<(f64, Option<f64>)>,
    /// Column of the principal point, from 0; default: the middle
    #[arg(long, value_name = "PX", allow_negative_numbers = true, requires = "fx", conflicts_with_all = ["fov", "intrinsics"])]
    pub(crate) cx: Option<f64>,
    /// Row of the principal point, from 0; default: the middle
    #[arg(long, value_name = "PX", allow_negative_numbers = true, requires = "fx", conflicts_with_all = ["fov", "intrinsics"])]
    pub(crate) cy: Option<f64>,
    /// Horizontal field of view, degrees
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub(crate) fov: Option<f64>,
}

/// The sizes of the results and of the refinement.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Size")]
pub(crate) struct SizeArgs {
    /// Resize the image, its prior, camera and truth to this longer side
    #[arg(long, help_heading = "Advanced", value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(8..))]
    pub(crate) max_size: Option<u32>,
    /// Refine a larger photograph at this many million pixels. The maps of one photograph are brought back to its own size, with its
    /// edges; those of several are not
    #[arg(long, help_heading = "Advanced", value_name = "MEGAPIXELS", default_value_t = Sizes::default().megapixels, value_parser = positive)]
    pub(crate) work_size: f64,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
}

/// The memory limit.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Size")]
pub(crate) struct MemoryArgs {
    /// Refuse runs whose estimated memory exceeds this; fewer predictions run at once where that suffices
    #[arg(long, help_heading = "Advanced", value_name = "GIB", default_value_t = MemoryLimit::USUAL, value_parser = positive)]
    pub(crate) max_memory: f64,
}

/// A preset with settings over it.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct PresetArgs {
    /// Preset of the settings; default: multi-view with several photographs, default with one
    #[arg(long, value_name = "NAME", value_parser = choice(PRESETS))]
    pub(crate) preset: Option<Preset>,
    /// Settings over those of the preset, a TOML file or KEY=VALUE, repeatable; `mde config` prints all
    #[arg(long, value_name = "FILE|KEY=VALUE")]
    pub(crate) config: Vec<OsString>,
}

/// The settings.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct SettingsArgs {
    #[command(flatten)]
    pub(crate) preset: PresetArgs,
    /// Seed of all random draws; default: that of the settings, 0
    #[arg(long, help_heading = "Advanced", value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(crate) seed: Option<u64>,
    /// Fit no field
    #[arg(long)]
    pub(crate) no_nerf: bool,
    /// Network predictions per photograph (whole, mirrored, crops): auto or a number; 1: the whole image alone
    #[arg(long, value_name = "N|auto")]
    pub(crate) predictions: Option<Predictions>,
    /// Nearest and farthest depth of the scene, metres, for disparity of unknown scale and shift; default: those of the settings, 0.8,8
    #[arg(long, help_heading = "Advanced", value_name = "NEAR,FAR", value_parser = depth_range)]
    pub(crate) depth_range: Option<[f64; 2]>,
}

/// Ground truth for the scores.
#[derive(Debug, Args)]
#[command(next_help_heading = "Truth")]
pub(crate) struct TruthArgs {
    /// Ground-truth depth of the image's size, metres (0: missing), to score prior and refined depth
    #[arg(long, value_name = "FILE")]
    pub(crate) gt: Option<PathBuf>,
}

/// The requested error bar.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Error bar")]
pub(crate) struct ErrorBarArgs {
    /// Also write lower.npy and upper.npy, an interval meant to contain the true depth with this probability
    #[arg(long, value_name = "P", value_parser = probability)]
    pub(crate) interval: Option<f64>,
    /// Calibration file of `mde calibrate`: scales sigma and intervals
    #[arg(long, value_name = "FILE")]
    pub(crate) calibration: Option<PathBuf>,
}

impl RefineArgs {
    /// Everything that the command names to be refined.
    pub(crate) fn photographs(&self) -> Vec<&Path> {
        std::iter::once(&self.image).chain(&self.more).map(PathBuf::as_path).collect()
    }
}

/// `WxH` as `[width, height]`.
fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match sides {
        Some(sides) if sides.iter().all(|side| (8..=16384).contains(side)) => Ok(sides),
        _ => Err("give WIDTHxHEIGHT with 8 to 16384 pixels each, such as 320x240".to_owned()),
    }
}

/// Finite numbers, separated by commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
    numbers.try_into().ok().filter(|numbers: &[f64; N]| numbers.iter().all(|number| number.is_finite()))
}

fn positive(text: &str) -> Result<f64, String> {
    match numbers(text) {
        Some([number]) if number > 0.0 => Ok(number),
        _ => Err("give a positive number".to_owned()),
    }
}

/// `FX` or `FX,FY`.
fn focal(text: &str) -> Result<(f64, Option<f64>), String> {
    let (fx, fy) = text.split_once(',').map_or((text, None), |(fx, fy)| (fx, Some(fy)));
    let number =
        |text: &str| text.trim().parse().map_err(|_| "give pixels, such as 520 or 520,521".to_owned());
    Ok((number(fx)?, fy.map(number).transpose()?))
}

fn depth_range(text: &str) -> Result<[f64; 2], String> {
    match numbers(text) {
        Some([near, far]) if near > 0.0 && far > near => Ok([near, far]),
        _ => Err("give two positive numbers, the nearer first, such as 0.8,8".to_owned()),
    }
}

fn probability(text: &str) -> Result<f64, String> {
    match numbers(text) {
        Some([number]) if (0.01..=0.99).contains(&number) => Ok(number),
        _ => Err("give 0.01 to 0.99, such as 0.9".to_owned()),
    }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    match numbers(text) {
        Some([degrees]) if 0.0 < degrees && degrees < 180.0 => Ok(degrees),
        _ => Err("give degrees above 0 and below 180, such as 60".to_owned()),
    }
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers(text).ok_or_else(|| "give three numbers, such as 0.05,0,-0.1".to_owned())
}

#[cfg(test)]
mod tests;
