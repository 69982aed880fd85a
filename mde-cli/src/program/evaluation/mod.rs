//! Methods on many scenes, for `mde eval`, `mde ablate` and `mde calibrate`.

pub(crate) mod ablation;
pub(crate) mod fields;
pub(crate) mod method;
pub(crate) mod results;
pub(crate) mod runner;
pub(crate) mod scenes;
pub(crate) mod scoring;
pub(crate) mod store;
