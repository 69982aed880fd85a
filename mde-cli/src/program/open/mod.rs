//! From the command line to a prior, settings and scenes.

pub(crate) mod photographs;
pub(crate) mod prior;
pub(crate) mod scene;
pub(crate) mod settings;
pub(crate) mod truth;
