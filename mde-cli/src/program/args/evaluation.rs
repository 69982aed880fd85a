//! The arguments of the commands that run over many scenes.

use crate::program::args::{KindName, MemoryArgs, PresetName, RunArgs, size};
use crate::program::many::Shard;
use clap::{Args, ValueEnum};
use mde_eval::align::AlignmentRule;
use mde_eval::data::DataSetKind;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-eval for SUNRGBD")),
    after_help = "\
Examples:
  mde eval SUNRGBD --dataset sunrgbd --prior-model fastdepth_224.onnx --methods paper,default,guided -o out/eval
  mde eval --dataset rooms --simulated-prior --size 320x240 --methods default,my.toml,jbf -o out/rooms

Methods: the presets paper, default, fast and multi-view; consensus (plane sweeps without a field); field (multi-view);
a TOML file that overrides --preset; the baselines prior, flip, zoom, unsharp0.5, unsharp1, unsharp2, noise, guided, jbf, wmf and fbs, and with several
photographs gauged and sweep; baselines chained with a plus, such as zoom+jbf.

Output: report.html, table.md, summary.json, scenes.csv, figures (SVG), eval.json (what was evaluated), and every map under
scenes/. Results are stored: the same command resumes after an interruption, further methods are added to the
folder, and a method whose settings changed is run again. With --shard only the maps of a part, which the same command
without --shard uses."
)]
pub(crate) struct EvalArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// Methods to compare with the prior, separated by commas
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        default_value = "default",
        help_heading = "Methods"
    )]
    pub(crate) methods: Vec<String>,
    /// Preset of methods in TOML files
    #[arg(long, value_enum, default_value = "default", help_heading = "Methods")]
    pub(crate) preset: PresetName,
    /// Seed of all random draws
    #[arg(long, value_name = "N", help_heading = "Methods")]
    pub(crate) seed: Option<u64>,
    /// Only part I of N of the scenes, by their names, into a folder that all parts share; the same command without --shard does what is
    /// missing and writes the tables
    #[arg(long, value_name = "I/N", help_heading = "Output")]
    pub(crate) shard: Option<Shard>,
}

#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-eval for SUNRGBD, as of mde eval")),
    after_help = "\
Examples:
  mde calibrate SUNRGBD --dataset sunrgbd --prior-model fastdepth_224.onnx -o out/calibration
  mde refine room.jpg --prior-model fastdepth_224.onnx --calibration out/calibration/calibration.toml --interval 0.9 -o out/room

Output: calibration.toml (half widths of intervals in sigmas, and their coverage of held-out scenes), and the output of mde
eval. The stored results of an evaluation in the same folder are reused."
)]
pub(crate) struct CalibrateArgs {
    #[command(flatten)]
    pub(crate) common: EvaluationArgs,
    /// Method to calibrate: a preset, or a TOML file that overrides --preset
    #[arg(long, value_name = "NAME", default_value = "default", help_heading = "Method")]
    pub(crate) method: String,
    /// Preset of methods in TOML files
    #[arg(long, value_enum, default_value = "default", help_heading = "Method")]
    pub(crate) preset: PresetName,
    /// Seed of all random draws
    #[arg(long, value_name = "N", help_heading = "Method")]
    pub(crate) seed: Option<u64>,
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
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of ROOT, or of the data set where it has none: SUNRGBD-ablate for SUNRGBD")),
    after_help = "\
Examples:
  mde ablate --dataset rooms --size 160x120 --config quick.toml -o out/ablation
  mde ablate SUNRGBD --prior-model fastdepth_224.onnx --rows no-variance,min-depth,nerf-only --seeds 1 -o out/ablation

Rows, each one change of the full model: no-variance, min-depth, no-calibration, fixed-variance, kappa-0.02, -0.05, -0.1,
-0.2, nerf-only (the paper's Table II and variants); guided-for-nerf, noise-for-nerf (a filter in place of the NeRF);
original-pose, in-bin, spread, anchor (remedies). Rows that differ only after the first fit share that fit.

Output: as for mde eval, with the paper's Table II at the top of table.md. The same command resumes after an interruption."
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
    #[arg(long, value_enum, default_value = "paper", help_heading = "Rows")]
    pub(crate) preset: PresetName,
    /// Settings over those of the preset in all rows, a TOML file or KEY=VALUE, repeatable
    #[arg(long, value_name = "FILE|KEY=VALUE", help_heading = "Rows")]
    pub(crate) config: Vec<String>,
}

/// The scenes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct DataArgs {
    /// Layout of the data set: sunrgbd, nyu, tum, redwood, plain, rooms, captures or posed; default: detected from the folder
    #[arg(long, value_name = "NAME", value_parser = data_set)]
    pub(crate) dataset: Option<DataSetKind>,
    /// Resize images and truth (640x480 in the paper); default: their own size
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) size: Option<[usize; 2]>,
    /// Horizontal field of view of scenes without intrinsics, degrees (with a warning)
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = field_of_view)]
    pub(crate) assume_fov: f64,
    /// Use every Nth image of a sequence
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) stride: u16,
    /// SUN RGB-D: use the hole-filled depth_bfx as truth (its filled pixels are not measured)
    #[arg(long, help_heading = "Advanced")]
    pub(crate) filled_depth: bool,
    /// File with the place of each scene, one line SCENE PLACE per scene; intervals resample places
    #[arg(long, value_name = "FILE")]
    pub(crate) places: Option<PathBuf>,
    /// Captures: number of photographs per room, with the reference; each value of a list is a scene
    #[arg(long, help_heading = "Advanced", value_name = "N", value_delimiter = ',', default_value = "5")]
    pub(crate) photographs: Vec<usize>,
    /// Captures: distance of the further photographs from the reference / median depth
    #[arg(long, help_heading = "Advanced", value_name = "X", value_delimiter = ',', default_value = "0.1")]
    pub(crate) baseline: Vec<f64>,
    /// Captures and posed: rotation error of the given poses, degrees (20 mm of translation per degree); posed takes one value
    #[arg(long, help_heading = "Advanced", value_name = "DEG", value_delimiter = ',', default_value = "0")]
    pub(crate) pose_noise: Vec<f64>,
    /// Captures: gain of one further photograph, +X or -X by seed
    #[arg(long, help_heading = "Advanced", value_name = "X", value_delimiter = ',', default_value = "0")]
    pub(crate) gain: Vec<f64>,
    /// Withhold the poses of the further photographs from the methods
    #[arg(long, help_heading = "Advanced")]
    pub(crate) without_poses: bool,
    /// Withhold the cameras too: their field of view is assumed, and estimated with the poses
    #[arg(long, help_heading = "Advanced", requires = "without_poses")]
    pub(crate) without_intrinsics: bool,
    /// Scenes to run, separated by commas; default: all
    #[arg(long, value_name = "IDS", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Run at most N scenes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) limit: Option<u32>,
}

/// The priors.
#[derive(Debug, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct EvalPriorArgs {
    /// A monocular depth network
    #[arg(long, value_name = "MODEL.onnx", conflicts_with_all = ["prior_depth", "simulated_prior", "simulated_model"])]
    pub(crate) prior_model: Option<PathBuf>,
    /// A folder with one depth map per scene: SCENE.npy (or .npz, .pfm, .png, .exr)
    #[arg(long, value_name = "DIR", conflicts_with_all = ["simulated_prior", "simulated_model"])]
    pub(crate) prior_depth: Option<PathBuf>,
    /// A degraded exact depth: blurred, distorted, as disparity without scale (rooms and captures only)
    #[arg(long)]
    pub(crate) simulated_prior: bool,
    /// A simulated model of the room with this fault, for augmentation (rooms only)
    #[arg(long, value_name = "FAULT", value_enum, conflicts_with = "simulated_prior")]
    pub(crate) simulated_model: Option<FaultName>,
    /// Input and output format of the model; default: MODEL.toml beside MODEL.onnx, else by its name
    #[arg(long, value_name = "NAME", requires = "prior_model")]
    pub(crate) model_profile: Option<String>,
    /// Kind of the values; by default metric for files, and that of the profile for a model
    #[arg(long, value_enum)]
    pub(crate) prior_kind: Option<KindName>,
    /// Depth = value / X for files; 1000 for 16-bit PNG, 1 for floats
    #[arg(long, value_name = "X", requires = "prior_depth")]
    pub(crate) png_scale: Option<f64>,
    /// What runs the model: tract, onnxruntime, auto, or the path of ONNX Runtime's library [default: tract]
    #[arg(long, help_heading = "Advanced", value_name = "NAME|LIBRARY", requires = "prior_model")]
    pub(crate) runtime: Option<String>,
}

/// Depth maps of other programs.
#[derive(Debug, Args)]
#[command(
    mut_arg("output", |output| output.help("Output folder; by default one in the working folder, with the name of PRED: maps-score for maps")),
    after_help = "\
Example:
  mde score maps --gt truth --sigma sigmas -o out/maps

Output: that of mde eval. Maps are .npy, .npz, .pfm, .png or .exr; those of the same name belong together."
)]
pub(crate) struct ScoreMapsArgs {
    /// A folder of depth maps to score
    #[arg(value_name = "PRED")]
    pub(crate) pred: PathBuf,
    /// A folder with ground truth of the same names, metres; 0: missing
    #[arg(long, value_name = "DIR")]
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
    #[command(flatten)]
    pub(crate) score: ScoreArgs,
    #[command(flatten)]
    pub(crate) memory: MemoryArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The scores.
#[derive(Debug, Args)]
#[command(next_help_heading = "Scores")]
pub(crate) struct ScoreArgs {
    /// Alignment of a map to the truth
    #[arg(long, value_enum, default_value = "median")]
    pub(crate) alignment: AlignmentName,
    /// Use the prior's alignment for every method
    #[arg(long)]
    pub(crate) shared_alignment: bool,
    /// Ignore true depths below, metres
    #[arg(long, value_name = "M")]
    pub(crate) min_depth: Option<f64>,
    /// Ignore true depths beyond, metres; default: that of the data set
    #[arg(long, value_name = "M")]
    pub(crate) max_depth: Option<f64>,
    /// Score only Eigen's crop of NYU's 640x480
    #[arg(long, help_heading = "Advanced")]
    pub(crate) eigen_crop: bool,
}

/// Parallelism.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct ManyArgs {
    /// Number of scenes that run at once and share the threads; default: 1
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
    /// None: for metric depth
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

/// Faults of a simulated model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FaultName {
    /// Predictions of low resolution, with soft edges
    Resolution,
    /// Predictions of low resolution that lose what is narrower than two of their pixels
    Thin,
    /// Every prediction loses what is narrower than a hundredth of the image
    Missed,
    /// All predictions share a low-frequency error
    Shared,
    /// Each prediction has a low-frequency error of its own
    Own,
    /// All of these
    All,
}

fn field_of_view(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(degrees) if 0.0 < degrees && degrees < 180.0 => Ok(degrees),
        _ => Err("give degrees above 0 and below 180, such as 60".to_owned()),
    }
}

fn data_set(name: &str) -> Result<DataSetKind, String> {
    name.parse().map_err(|error: mde_eval::Error| error.to_string())
}
