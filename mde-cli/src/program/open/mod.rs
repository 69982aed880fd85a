//! From the command line to a prior, settings and scenes.

pub(crate) mod photographs;
pub(crate) mod prior;
pub(crate) mod scene;
mod settings;

pub(crate) use photographs::{content, existing};
pub(crate) use scene::Opener;
pub(crate) use settings::*;
