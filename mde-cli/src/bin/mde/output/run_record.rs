//! `run.json`: the record of a run.

use crate::input::camera::KnownCamera;
use crate::input::known::Scaled;
use crate::input::prior::PriorOrigin;
use crate::input::truth::Comparison;
use crate::output::provenance::{command_line, peak_memory, versions};
use crate::run::batch::SameScale;
use crate::run::error_bar::Stated;
use crate::run::progress::TrainingCurve;
use mde_cli::{AugmentationReport, CaptureReport, IterationReport};
use serde::Serialize;
use std::collections::BTreeMap;

/// Record of `mde demo` and `mde refine`.
#[derive(Debug, Serialize)]
pub(crate) struct RunRecord<'r> {
    #[serde(flatten)]
    pub(crate) about: About<'r>,
    pub(crate) prior: &'r PriorOrigin,
    /// The depth files' unit.
    pub(crate) unit: &'static str,
    /// depth.png = depth times this.
    pub(crate) png_scale: f64,
    /// Pixels too far for depth.png, missing there.
    pub(crate) png_missing_pixels: usize,
    /// Pixels without a refined depth.
    pub(crate) missing_pixels: usize,
    /// The prior's stage.
    pub(crate) augmentation: &'r AugmentationReport,
    /// How sigma was scaled, and the interval.
    pub(crate) error_bar: &'r Stated,
    /// Several photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) capture: Option<&'r CaptureReport>,
    /// Scale by known depths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) scale: Option<&'r Scaled>,
    /// One scale for many photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) same_scale: Option<&'r SameScale>,
    pub(crate) iterations: &'r [IterationReport],
    /// Curves of the fit of every iteration.
    pub(crate) training: &'r [TrainingCurve],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) scores: Option<&'r Comparison>,
    pub(crate) prior_seconds: f64,
    pub(crate) score_seconds: f64,
}

/// Common part of the records of all commands.
#[derive(Debug, Serialize)]
pub(crate) struct About<'r> {
    pub(crate) command: &'static str,
    /// The command line, quoted for a shell.
    pub(crate) command_line: String,
    pub(crate) versions: BTreeMap<&'static str, &'static str>,
    /// The image, field or room.
    pub(crate) input: String,
    pub(crate) camera: &'r KnownCamera,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) preset: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) seed: Option<u64>,
    pub(crate) threads: usize,
    pub(crate) warnings: &'r [String],
    /// From the program's start to this record.
    pub(crate) total_seconds: f64,
    pub(crate) peak_memory_bytes: Option<u64>,
}

impl<'r> About<'r> {
    pub(crate) fn new(command: &'static str, input: String, camera: &'r KnownCamera) -> Self {
        Self {
            command,
            command_line: command_line(),
            versions: versions(),
            input,
            camera,
            preset: None,
            seed: None,
            threads: rayon::current_num_threads(),
            warnings: &[],
            total_seconds: 0.0,
            peak_memory_bytes: peak_memory(),
        }
    }
}
