//! The arguments of the commands that run over many scenes.

use crate::config::Preset;
use crate::program::args::values::{ALIGNMENTS, choice, field_of_view, grid, size};
use crate::program::{MemoryArgs, NetworkArgs, RunArgs};
use clap::{Args, ValueEnum};
use mde_eval::align::AlignmentRule;
use mde_eval::data::{CaptureGrid, DataSetKind, Shard};
use std::ffi::OsString;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-eval for SUNRGBD")),
    after_help = include_str!("help/eval.txt").trim_end()
)]
pub(crate) struct EvalArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    #[command(flatten)]
    pub(crate) several: CaptureArgs,
    #[command(flatten)]
    pub(crate) pixels: PixelArgs,
    /// Methods to compare with the prior, separated by commas
    #[arg(long, help_heading = "Methods", value_name = "NAMES")]
    #[arg(value_delimiter = ',', default_value = "default")]
    pub(crate) methods: Vec<String>,
    /// Seed of all random draws
    #[arg(long, value_name = "N", help_heading = "Methods")]
    pub(crate) seed: Option<u64>,
    /// Only part I of N of the scenes, into a folder that all parts share; the same command without --shard writes the tables
    #[arg(long, value_name = "I/N", help_heading = "Output")]
    pub(crate) shard: Option<Shard>,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-eval for SUNRGBD, as of mde eval")),
    after_help = include_str!("help/calibrate.txt").trim_end()
)]
pub(crate) struct CalibrateArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// What methods are not given of several photographs
    #[arg(long, help_heading = "Advanced", value_enum, value_name = "WHAT")]
    pub(crate) withhold: Option<Withheld>,
    /// Method to calibrate: a preset, a TOML file over default, or over another preset as in multi-view:my.toml
    #[arg(long, value_name = "NAME", default_value = "default", help_heading = "Method")]
    pub(crate) method: String,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-ablate for SUNRGBD")),
    after_help = include_str!("help/ablate.txt").trim_end()
)]
pub(crate) struct AblateArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// Rows to run beside the full model, separated by commas; default: all
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Rows")]
    pub(crate) rows: Vec<String>,
    /// Number of seeds to average
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=100), help_heading = "Rows")]
    pub(crate) seeds: u16,
    /// Preset of the full model
    #[arg(long, value_name = "NAME", default_value = "paper", help_heading = "Rows")]
    pub(crate) preset: Preset,
    /// Settings over those of the preset in all rows, a TOML file or KEY=VALUE, repeatable
    #[arg(long, value_name = "FILE|KEY=VALUE", help_heading = "Rows")]
    pub(crate) config: Vec<OsString>,
}

/// Arguments of all evaluations.
#[derive(Debug, Args)]
pub(crate) struct EvaluationArgs {
    /// Folder of the data set; none for rooms and captures
    #[arg(value_name = "ROOT")]
    pub(crate) root: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) data: DataArgs,
    #[command(flatten)]
    pub(crate) prior: EvalPriorArgs,
    /// Alignment of a map to the truth
    #[arg(long, help_heading = "Scores", value_name = "RULE", value_parser = choice(ALIGNMENTS), default_value = "median-ratio")]
    pub(crate) alignment: (AlignmentRule, bool),
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    /// Scenes that run at once and share the threads
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256), help_heading = "Output")]
    pub(crate) jobs: u16,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The scenes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct DataArgs {
    /// Layout of the data set: sunrgbd, nyu, plain, rooms, captures or posed; default: detected from the folder
    #[arg(long, value_name = "NAME")]
    pub(crate) dataset: Option<DataSetKind>,
    /// Resize images and truth (640x480 in the paper); default: their own size
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[usize; 2]>,
    /// Horizontal field of view of scenes without intrinsics, degrees (with a warning)
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = field_of_view)]
    pub(crate) assume_fov: f64,
    /// Scenes to run, separated by commas; default: all
    #[arg(long, value_name = "IDS", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Run at most N scenes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) limit: Option<u32>,
}

/// Scenes of several photographs.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct CaptureArgs {
    /// Conditions of captures, every combination a scene: views (with the reference), baseline (over median depth), pose-noise (degrees,
    /// and 20 mm each), gain (of one photograph). For posed one pose-noise
    #[arg(long, help_heading = "Advanced", value_name = "KEY=LIST;...", value_parser = grid)]
    pub(crate) grid: Option<CaptureGrid>,
    /// What methods are not given of several photographs
    #[arg(long, help_heading = "Advanced", value_enum, value_name = "WHAT")]
    pub(crate) withhold: Option<Withheld>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Withheld {
    /// Their poses
    Poses,
    /// Poses and cameras, whose field of view is then --assume-fov
    Cameras,
}

/// The priors.
#[derive(Debug, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct EvalPriorArgs {
    /// A monocular depth network
    #[arg(long, value_name = "MODEL.onnx", conflicts_with_all = ["prior_depth", "simulated"])]
    pub(crate) prior_model: Option<PathBuf>,
    /// A folder with one depth map per scene: SCENE.npy (or .npz, .pfm, .png, .exr)
    #[arg(long, value_name = "DIR", conflicts_with = "simulated")]
    pub(crate) prior_depth: Option<PathBuf>,
    /// A prior made of the exact depth of rooms and captures
    #[arg(long, value_enum, value_name = "WHAT")]
    pub(crate) simulated: Option<Simulated>,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Simulated {
    /// A depth map: blurred, distorted, as disparity without scale
    Prior,
    /// A network with the faults of a small one, which predicts crops too (rooms only)
    Model,
}

/// Depth maps of other programs.
#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of PRED: maps-score for maps")),
    after_help = include_str!("help/score.txt").trim_end()
)]
pub(crate) struct ScoreMapsArgs {
    /// A folder of depth maps to score, or that of mde dense
    #[arg(value_name = "PRED")]
    pub(crate) pred: PathBuf,
    /// A folder with ground truth of the same names, metres; 0: missing; of mde dense a transforms.json with a depth_file_path of each frame
    #[arg(long, value_name = "PATH")]
    pub(crate) gt: PathBuf,
    /// A folder with their standard deviations, in the depth's unit
    #[arg(long, value_name = "DIR")]
    pub(crate) sigma: Option<PathBuf>,
    /// Predicted depth = value / X; 1000 for 16-bit PNG, 1 for floats
    #[arg(long, help_heading = "Advanced", value_name = "X")]
    pub(crate) png_scale: Option<f64>,
    /// Scenes to score, separated by commas; default: all
    #[arg(long, value_name = "IDS", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Alignment of a map to the truth
    #[arg(long, help_heading = "Scores", value_name = "RULE", value_parser = choice(ALIGNMENTS), default_value = "median-ratio")]
    pub(crate) alignment: (AlignmentRule, bool),
    #[command(flatten)]
    pub(crate) pixels: PixelArgs,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The pixels that are scored.
#[derive(Debug, Clone, Copy, Default, Args)]
#[command(next_help_heading = "Scores")]
pub(crate) struct PixelArgs {
    /// Ignore true depths beyond, metres; default: that of the data set
    #[arg(long, value_name = "M")]
    pub(crate) max_depth: Option<f64>,
    /// Score only a part of the image
    #[arg(long, help_heading = "Advanced", value_enum, value_name = "NAME")]
    pub(crate) crop: Option<CropName>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum CropName {
    /// That of Eigen et al., of NYU's 640x480
    Eigen,
}
