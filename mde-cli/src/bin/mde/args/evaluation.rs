//! The arguments of the commands that run over many scenes.

use super::{EncodingName, KindName, MemoryArgs, PresetName, RunArgs, size};
use clap::{Args, ValueEnum};
use mde_eval::align::AlignmentRule;
use mde_eval::data::DataSetKind;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde eval SUNRGBD --dataset sunrgbd --prior-model fastdepth_224.onnx --methods paper,default,guided -o out/eval
  mde eval --dataset rooms --simulated-prior --size 320x240 --methods default,my.toml,jbf -o out/rooms
  mde eval --pred maps --sigma sigmas --gt truth -o out/maps

Methods: the presets paper, default and fast; a TOML file of settings over --preset; the baselines prior, flip, zoom,
unsharp0.5, unsharp1, unsharp2, noise, guided, jbf, wmf and fbs; one after the other with a plus, such as zoom+jbf.

Output: report.html, table.md, summary.json, scenes.csv, figures (SVG and PNG), eval.json (what was evaluated), and every map under
scenes/. What is there already is not run again: the same command goes on after an interruption, with other methods it
adds them, and a method whose settings changed is run anew.")]
pub(crate) struct EvalArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// What is compared with the prior, separated by commas
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        default_value = "default",
        help_heading = "Methods",
        conflicts_with = "pred"
    )]
    pub(crate) methods: Vec<String>,
    /// What a method in a TOML file starts from
    #[arg(long, value_enum, default_value = "default", help_heading = "Methods")]
    pub(crate) preset: PresetName,
    /// Every random draw comes from it
    #[arg(long, value_name = "N", help_heading = "Methods")]
    pub(crate) seed: Option<u64>,
    #[command(flatten)]
    pub(crate) maps: MapArgs,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde calibrate SUNRGBD --dataset sunrgbd --prior-model fastdepth_224.onnx -o out/calibration
  mde refine room.jpg --prior-model fastdepth_224.onnx --calibration out/calibration/calibration.toml --interval 0.9 -o out/room

Output: calibration.toml (half widths of intervals in sigmas, and what scenes that were left out say of them), and all that mde
eval writes. In the folder of an evaluation, what is there already is not run again.")]
pub(crate) struct CalibrateArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// Whose sigma: a preset, or a TOML file of settings over --preset
    #[arg(long, value_name = "NAME", default_value = "default", help_heading = "Method")]
    pub(crate) method: String,
    /// What a method in a TOML file starts from
    #[arg(long, value_enum, default_value = "default", help_heading = "Method")]
    pub(crate) preset: PresetName,
    /// Every random draw comes from it
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub(crate) seed: Option<u64>,
}

/// What every evaluation is asked.
#[derive(Debug, Args)]
pub(crate) struct EvaluationArgs {
    /// The data set's folder; none for rooms and captures
    #[arg(value_name = "ROOT")]
    pub(crate) root: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) data: DataArgs,
    #[command(flatten)]
    pub(crate) prior: EvalPriorArgs,
    #[command(flatten)]
    pub(crate) score: ScoreArgs,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) many: ManyArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde ablate --dataset rooms --size 160x120 --config quick.toml -o out/ablation
  mde ablate SUNRGBD --prior-model fastdepth_224.onnx --rows no-variance,min-depth,nerf-only --seeds 1 -o out/ablation

Rows, each a change of one thing in the full model: no-variance, no-variance-mean, min-depth, min-variance, mean, median,
no-calibration, ols, fixed-variance, kappa-0.02, -0.05, -0.1, -0.2, nerf-only (the paper's Table II and its kin);
guided-for-nerf, noise-for-nerf (no NeRF at all); original-pose, in-bin, spread, effective, anchor,
heteroscedastic, all (remedies). Rows that differ after the first fit alone share it.

Output: as of mde eval, with the paper's Table II at the top of table.md. Goes on where an interrupted run stopped.")]
pub(crate) struct AblateArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// Only these rows and the full model, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Rows")]
    pub(crate) rows: Vec<String>,
    /// How many seeds are averaged
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=100), help_heading = "Rows")]
    pub(crate) seeds: u16,
    /// What the full model starts from
    #[arg(long, value_enum, default_value = "paper", help_heading = "Rows")]
    pub(crate) preset: PresetName,
    /// TOML with settings over the preset's, for all rows
    #[arg(long, value_name = "FILE", help_heading = "Rows")]
    pub(crate) config: Option<PathBuf>,
}

/// Which scenes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct DataArgs {
    /// The data set's layout: sunrgbd, nyu, tum, redwood, plain, rooms, captures or posed; recognised if not given
    #[arg(long, value_name = "NAME", value_parser = data_set)]
    pub(crate) dataset: Option<DataSetKind>,
    /// Resize pictures and truth (640x480 in the paper); their own size if not given
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[usize; 2]>,
    /// Horizontal field of view of scenes without intrinsics (each is a warning)
    #[arg(long, value_name = "DEG", default_value_t = 60.0)]
    pub(crate) assume_fov: f64,
    /// Sequences: every Nth picture
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) stride: u16,
    /// SUN RGB-D: take the hole-filled depth_bfx as truth (it invents depth)
    #[arg(long)]
    pub(crate) filled_depth: bool,
    /// Which scenes show the same place: lines of SCENE PLACE; intervals resample places
    #[arg(long, value_name = "FILE")]
    pub(crate) places: Option<PathBuf>,
    /// Captures: number of photographs of a room, with the reference; several for each in turn
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "5")]
    pub(crate) photographs: Vec<usize>,
    /// Captures: distance of the further photographs over the median depth
    #[arg(long, value_name = "X", value_delimiter = ',', default_value = "0.1")]
    pub(crate) baseline: Vec<f64>,
    /// Captures: rotation error of the given poses, degrees (20 mm of translation per degree)
    #[arg(long, value_name = "DEG", value_delimiter = ',', default_value = "0")]
    pub(crate) pose_noise: Vec<f64>,
    /// Captures: gain of one further photograph, +X or -X by seed
    #[arg(long, value_name = "X", value_delimiter = ',', default_value = "0")]
    pub(crate) gain: Vec<f64>,
    /// Only these scenes, separated by commas
    #[arg(long, value_name = "IDS", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// At most so many scenes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) limit: Option<u32>,
}

/// Where the monocular depths come from.
#[derive(Debug, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct EvalPriorArgs {
    /// A monocular depth network
    #[arg(long, value_name = "MODEL.onnx", conflicts_with_all = ["prior_depth", "simulated_prior", "simulated_model"])]
    pub(crate) prior_model: Option<PathBuf>,
    /// A folder with one depth map a scene: SCENE.npy (or .npz, .pfm, .png, .exr)
    #[arg(long, value_name = "DIR", conflicts_with_all = ["simulated_prior", "simulated_model"])]
    pub(crate) prior_depth: Option<PathBuf>,
    /// The exact depth made worse: blurred, bent, as disparity without scale (rooms and captures only)
    #[arg(long)]
    pub(crate) simulated_prior: bool,
    /// A model of the room that can be asked again and has this fault (rooms only)
    #[arg(long, value_name = "FAULT", value_enum, conflicts_with = "simulated_prior")]
    pub(crate) simulated_model: Option<FaultName>,
    /// What the model wants and gives; else MODEL.toml beside MODEL.onnx, else guessed from its name
    #[arg(long, value_name = "NAME", requires = "prior_model")]
    pub(crate) model_profile: Option<String>,
    /// What the numbers mean; metric for files, the profile's for a model
    #[arg(long, value_enum)]
    pub(crate) prior_kind: Option<KindName>,
    /// Depth = value / X for files; 1000 for 16-bit PNG, 1 for floats
    #[arg(long, value_name = "X", requires = "prior_depth")]
    pub(crate) png_scale: Option<f64>,
}

/// What has no say in maps that are there already.
const MADE_HERE: [&str; 18] = [
    "root",
    "dataset",
    "size",
    "assume_fov",
    "stride",
    "filled_depth",
    "places",
    "photographs",
    "baseline",
    "pose_noise",
    "gain",
    "prior_model",
    "prior_depth",
    "simulated_prior",
    "simulated_model",
    "methods",
    "seed",
    "jobs",
];

/// Maps that were made elsewhere.
#[derive(Debug, Args)]
#[command(next_help_heading = "Maps of another program")]
pub(crate) struct MapArgs {
    /// A folder of depth maps (.npy, .npz, .pfm, .png, .exr) to be scored
    #[arg(long, value_name = "DIR", requires = "gt", conflicts_with_all = MADE_HERE)]
    pub(crate) pred: Option<PathBuf>,
    /// A folder with their truths in metres, of the same names; 0 = missing
    #[arg(long, value_name = "DIR", requires = "pred")]
    pub(crate) gt: Option<PathBuf>,
    /// A folder with their standard deviations, in the depth's unit
    #[arg(long, value_name = "DIR", requires = "pred")]
    pub(crate) sigma: Option<PathBuf>,
    /// How the truth's PNGs hold their depths
    #[arg(long, value_enum, default_value = "plain", requires = "gt")]
    pub(crate) gt_encoding: EncodingName,
    /// True depth = value / X; 1000 for 16-bit PNG, 1 for floats
    #[arg(long, value_name = "X", requires = "gt")]
    pub(crate) gt_scale: Option<f64>,
    /// Predicted depth = value / X; 1000 for 16-bit PNG, 1 for floats
    #[arg(long, value_name = "X", requires = "pred")]
    pub(crate) pred_scale: Option<f64>,
}

/// How it is scored.
#[derive(Debug, Args)]
#[command(next_help_heading = "Scores")]
pub(crate) struct ScoreArgs {
    /// How a map is brought to the truth's scale
    #[arg(long, value_enum, default_value = "median")]
    pub(crate) alignment: AlignmentName,
    /// Give every method the prior's alignment instead of its own
    #[arg(long)]
    pub(crate) shared_alignment: bool,
    /// True depths below do not count, metres
    #[arg(long, value_name = "M")]
    pub(crate) min_depth: Option<f64>,
    /// True depths beyond do not count, metres; the data set's own if not given
    #[arg(long, value_name = "M")]
    pub(crate) max_depth: Option<f64>,
    /// Only Eigen's crop of NYU's 640x480 counts
    #[arg(long)]
    pub(crate) eigen_crop: bool,
}

/// How much at once.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct ManyArgs {
    /// Scenes at once; they share the threads
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub(crate) jobs: Option<u16>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum AlignmentName {
    /// By the ratio of the medians of truth and map
    Median,
    /// By the median of the pixels' ratios
    MedianRatio,
    /// Least squares, scale and shift, in depth
    LsDepth,
    /// Least squares, scale and shift, in disparity
    LsDisparity,
    /// As it is: for metric depth
    None,
}

impl From<AlignmentName> for AlignmentRule {
    fn from(name: AlignmentName) -> Self {
        match name {
            AlignmentName::Median => Self::Median,
            AlignmentName::MedianRatio => Self::MedianRatio,
            AlignmentName::LsDepth => Self::LeastSquaresDepth,
            AlignmentName::LsDisparity => Self::LeastSquaresDisparity,
            AlignmentName::None => Self::None,
        }
    }
}

/// What a simulated model gets wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FaultName {
    /// Its answers are small: edges are soft
    Resolution,
    /// They are small, and what is narrower than two of their pixels is lost
    Thin,
    /// What is narrower than a hundredth of the picture is lost in every answer
    Missed,
    /// All answers share a low-frequency error
    Shared,
    /// Each answer has a low-frequency error of its own
    Own,
    /// All of these
    All,
}

fn data_set(name: &str) -> Result<DataSetKind, String> {
    name.parse().map_err(|error: mde_eval::Error| error.to_string())
}
