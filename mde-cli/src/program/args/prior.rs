//! The prior: arguments of every command that reads or predicts one.

use crate::program::args::choice::{KINDS, choice};
use clap::Args;
use mde_prior::DepthKind;
use std::path::PathBuf;

/// Where the monocular depth comes from.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Prior")]
pub(crate) struct PriorArgs {
    #[command(flatten)]
    pub(crate) source: PriorSource,
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
    /// Kind of the values; by default that of the profile, and metric for a map whose metadata name no other unit
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

#[derive(Debug, Clone, Args)]
#[group(multiple = false)]
pub(crate) struct PriorSource {
    /// A monocular depth network
    #[arg(long, value_name = "MODEL.onnx", help_heading = "Prior")]
    pub(crate) prior_model: Option<PathBuf>,
    /// A depth map of the image's size: .npy, .npz, .png (16 bit), .pfm, .exr
    #[arg(long, value_name = "FILE", help_heading = "Prior")]
    pub(crate) prior_depth: Option<PathBuf>,
}
