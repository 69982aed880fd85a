//! What the steps found, as plain data: the records and pages of a run are made of it.

pub mod capture;
pub mod prediction;
mod refinement;

pub use capture::{CaptureReport, PoseSource};
pub use prediction::{AugmentationReport, Component};
pub use refinement::{IterationReport, Refinement, StageSeconds};
