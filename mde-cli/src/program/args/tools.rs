//! Arguments of the commands about the program and the machine.

use crate::program::args::choice::{KINDS, choice};
use clap::Args;
use mde_prior::DepthKind;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde doctor
  mde doctor --prior-model dpt_large.onnx
  mde doctor --prior-model net.onnx --model-profile net.toml --prior-kind disparity

A model is timed with every runtime that is found, and its predictions of procedural rooms are compared with the exact depth.")]
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

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde completions bash > ~/.local/share/bash-completion/completions/mde
  mde completions zsh > ~/.zfunc/_mde
  mde completions fish > ~/.config/fish/completions/mde.fish")]
pub(crate) struct CompletionsArgs {
    /// Shell
    #[arg(value_enum)]
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mde man > mde.1
  mde man refine | man -l -")]
pub(crate) struct ManArgs {
    /// Manual page of this subcommand instead of the program's
    #[arg(value_name = "COMMAND")]
    pub(crate) command: Option<String>,
}
