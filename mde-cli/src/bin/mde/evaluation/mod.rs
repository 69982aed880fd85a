//! Many methods on many scenes: what `mde eval` and `mde ablate` have in common.

pub(crate) mod ablation;
pub(crate) mod filtered;
pub(crate) mod method;
pub(crate) mod refiner;
pub(crate) mod results;
pub(crate) mod runner;
pub(crate) mod scenes;
pub(crate) mod scoring;
pub(crate) mod setup;
pub(crate) mod store;
