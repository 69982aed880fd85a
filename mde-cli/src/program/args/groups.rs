//! Arguments that several commands have.

use crate::config::Preset;
use crate::output::export::Format;
use crate::program::args::values::{KINDS, choice, depth_range, focal, formats, positive, probability};
use crate::refiner::{MemoryLimit, Unit};
use crate::scene::Sizes;
use clap::Args;
use mde_prior::DepthKind;
use mde_prior::augment::Predictions;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What `mde refine` and `mde dense` have in common.
#[derive(Debug, Args)]
#[command(next_help_heading = "Several photographs")]
pub(crate) struct RefinementArgs {
    /// Photographs that refine one at most, itself included: the best by parallax, overlap and sharpness; default: 8
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=64))]
    pub(crate) max_views: Option<u16>,
    /// Unit of depth and sigma: the prior's, or that of the capture's poses
    #[arg(long, help_heading = "Advanced", value_name = "UNIT", default_value = "prior")]
    pub(crate) unit: Unit,
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
    pub(crate) results: ResultArgs,
}

/// Where the monocular depth comes from.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct PriorArgs {
    /// A monocular depth network, such as FastDepth or Depth Anything V2; docs/models.md has the addresses
    #[arg(long, value_name = "MODEL.onnx", conflicts_with = "prior_depth")]
    pub(crate) prior_model: Option<PathBuf>,
    /// A depth map of the image's size: .npy, .npz, .png (16 bit), .pfm, .exr
    #[arg(long, value_name = "FILE")]
    pub(crate) prior_depth: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) network: NetworkArgs,
}

/// How the values of a network or a map are read.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct NetworkArgs {
    /// Format of the network: a profile's name or a .toml; default: MODEL.toml beside MODEL.onnx, else by its folder, graph or name
    #[arg(long, help_heading = "Advanced", value_name = "NAME|FILE", conflicts_with = "prior_depth")]
    pub(crate) model_profile: Option<String>,
    /// What the values are; default: the kind of the profile, metric for a map without a unit in its metadata
    #[arg(long, value_name = "KIND", value_parser = choice(KINDS))]
    pub(crate) prior_kind: Option<DepthKind>,
    /// Depth = value / X for a map; default: the scale in its metadata, else 1000 for 16-bit PNG and 1 for floats
    #[arg(long, help_heading = "Advanced", value_name = "X", conflicts_with = "prior_model")]
    pub(crate) png_scale: Option<f64>,
    /// What runs the network: tract (part of this program), onnxruntime, auto (ONNX Runtime if found, else tract), or the path of ONNX
    /// Runtime's library [default: tract]
    #[arg(long, help_heading = "Advanced", value_name = "NAME|LIBRARY", conflicts_with = "prior_depth")]
    pub(crate) runtime: Option<String>,
}

// Clap accepts an argument whose required argument conflicts with another, so such conflicts are listed too.

/// The pinhole camera.
#[derive(Debug, Args)]
#[command(next_help_heading = "Camera (default: EXIF, else 60 degrees, which several photographs correct)")]
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
pub(crate) struct MemoryArgs {
    /// Refuse runs whose estimated memory exceeds this; fewer predictions run at once where that suffices
    #[arg(long, help_heading = "Advanced", value_name = "GIB", default_value_t = MemoryLimit::USUAL, value_parser = positive)]
    pub(crate) max_memory: f64,
}

/// A preset with settings over it.
#[derive(Debug, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct PresetArgs {
    /// Preset of the settings; default: multi-view with several photographs, default with one
    #[arg(long, value_name = "NAME")]
    pub(crate) preset: Option<Preset>,
    /// Settings over those of the preset, a TOML file or KEY=VALUE, repeatable; `mde config` prints all
    #[arg(long, value_name = "FILE|KEY=VALUE")]
    pub(crate) config: Vec<OsString>,
}

/// The settings.
#[derive(Debug, Args)]
#[command(next_help_heading = "Settings")]
pub(crate) struct SettingsArgs {
    #[command(flatten)]
    pub(crate) preset: PresetArgs,
    /// Seed of all random draws; default: that of the settings, 0
    #[arg(long, help_heading = "Advanced", value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(crate) seed: Option<u64>,
    /// Leave out the radiance field: several times faster, less exact
    #[arg(long)]
    pub(crate) no_nerf: bool,
    /// Network predictions per photograph (whole, mirrored, crops): auto or a number; 1: the whole image alone
    #[arg(long, value_name = "N|auto")]
    pub(crate) predictions: Option<Predictions>,
    /// Nearest and farthest depth of the scene, metres, for disparity of unknown scale and shift; default: those of the settings, 0.8,8
    #[arg(long, help_heading = "Advanced", value_name = "NEAR,FAR", value_parser = depth_range)]
    pub(crate) depth_range: Option<[f64; 2]>,
}

/// The error bar and files for other programs.
#[derive(Debug, Args)]
#[command(next_help_heading = "Error bar")]
pub(crate) struct ResultArgs {
    /// Also write lower.npy and upper.npy: an interval that is to hold the true depth with this probability, such as 0.9
    #[arg(long, value_name = "P", value_parser = probability)]
    pub(crate) interval: Option<f64>,
    /// Calibration file of `mde calibrate`: scales sigma and intervals
    #[arg(long, value_name = "FILE")]
    pub(crate) calibration: Option<PathBuf>,
    /// Also write files for other programs, separated by commas
    #[arg(long, help_heading = "Output", value_name = "FORMATS", value_delimiter = ',', value_parser = formats(false))]
    pub(crate) export: Vec<Format>,
}

/// Output folder and progress.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct RunArgs {
    /// Output folder; by default one in the working folder, with the input's name
    #[arg(short, long, value_name = "DIR", help_heading = None::<&'static str>, display_order = 0)]
    pub(crate) output: Option<PathBuf>,
    /// Replace the folder of an earlier run
    #[arg(long)]
    pub(crate) force: bool,
    /// Number of threads; default: all cores. The results do not depend on it
    #[arg(long, help_heading = "Advanced", value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print errors only
    #[arg(short, long, conflicts_with = "log_json")]
    pub(crate) quiet: bool,
    /// Progress, warnings and results as JSON lines on stderr
    #[arg(long, help_heading = "Advanced")]
    pub(crate) log_json: bool,
}

impl RunArgs {
    /// The output, by default the name of `input` without its extension and with this ending, in the working folder.
    pub(crate) fn output(&self, input: &Path, ending: &str) -> PathBuf {
        self.output.clone().unwrap_or_else(|| {
            // A folder such as `.` has a name in its full path only.
            let full = std::path::absolute(input).ok();
            let own = if input.is_dir() { Path::file_name } else { Path::file_stem };
            let mut name = full.as_deref().and_then(own).unwrap_or("mde".as_ref()).to_owned();
            name.push(ending);
            name.into()
        })
    }
}
