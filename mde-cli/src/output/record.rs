//! `run.json`: the record of a run.

use crate::prior::origin::PriorOrigin;
use crate::refiner::error_bar::Stated;
use crate::refiner::finish::{Refined, Scaled};
use crate::reports::capture::CaptureReport;
use crate::reports::iteration::IterationReport;
use crate::reports::prediction::AugmentationReport;
use crate::scene::SameScale;
use crate::scene::camera::KnownCamera;
use mde_nerf::FieldEvent;
use serde::Serialize;
use std::collections::BTreeMap;

/// Curves of a fit, one entry per event.
#[derive(Debug, Default, Serialize)]
pub struct TrainingCurve {
    /// Steps done.
    pub step: Vec<usize>,
    /// Loss.
    pub loss: Vec<f64>,
    /// Of the training rays, dB.
    pub psnr: Vec<f64>,
}

/// Adds an event to the curves of the iterations; `iteration` is from 0.
pub fn follow(curves: &mut Vec<TrainingCurve>, iteration: usize, event: &FieldEvent) {
    let FieldEvent::Fit { step, loss, psnr, .. } = *event else { return };
    curves.resize_with((iteration + 1).max(curves.len()), Default::default);
    if let Some(curve) = curves.last_mut() {
        curve.step.push(step);
        curve.loss.push(loss);
        curve.psnr.push(psnr);
    }
}

/// Record of `mde demo`, `mde refine` and the Python package; `S` are scores by a ground truth.
#[derive(Debug, Serialize)]
pub struct RunRecord<'r, S: Serialize> {
    /// The common part.
    #[serde(flatten)]
    pub about: About<'r>,
    /// Where the prior comes from.
    pub prior: &'r PriorOrigin,
    /// The depth files' unit.
    pub unit: &'static str,
    /// depth.png = depth times this.
    pub png_scale: f64,
    /// Pixels too far for depth.png, missing there.
    pub png_missing_pixels: usize,
    /// Pixels without a refined depth.
    pub missing_pixels: usize,
    /// The prior's stage.
    pub augmentation: &'r AugmentationReport,
    /// How sigma was scaled, and the interval.
    pub error_bar: &'r Stated,
    /// Several photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture: Option<&'r CaptureReport>,
    /// Scale by known depths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<&'r Scaled>,
    /// One scale for many photographs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub same_scale: Option<&'r SameScale>,
    /// The iterations of the loop.
    pub iterations: &'r [IterationReport],
    /// Curves of the fit of every iteration.
    pub training: &'r [TrainingCurve],
    /// Scores by a ground truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scores: Option<&'r S>,
    /// Of the prior's predictions.
    pub prior_seconds: f64,
    /// Of the scores.
    pub score_seconds: f64,
}

impl<'r, S: Serialize> RunRecord<'r, S> {
    /// Of a result without scores.
    pub fn new(about: About<'r>, result: &'r Refined<'_>, training: &'r [TrainingCurve]) -> Self {
        let refinement = &result.refinement;
        Self {
            about,
            prior: &result.origin,
            unit: result.unit,
            png_scale: result.png.scale,
            png_missing_pixels: result.png.beyond,
            missing_pixels: refinement.depth.variance().iter().filter(|v| v.is_infinite()).count(),
            augmentation: &refinement.augmentation,
            error_bar: &result.stated,
            capture: refinement.capture.as_ref(),
            scale: result.scaled.as_ref(),
            same_scale: result.same_scale.as_ref(),
            iterations: &refinement.iterations,
            training,
            scores: None,
            prior_seconds: result.prior_seconds,
            score_seconds: 0.0,
        }
    }
}

/// Common part of the records of all commands.
#[derive(Debug, Serialize)]
pub struct About<'r> {
    /// The command.
    pub command: &'static str,
    /// The command line, quoted for a shell; none for a call.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub command_line: Option<String>,
    /// Versions of the crates.
    pub versions: BTreeMap<&'static str, &'static str>,
    /// The image, field or room.
    pub input: String,
    /// The camera of the maps.
    pub camera: &'r KnownCamera,
    /// The preset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<&'static str>,
    /// The seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Number of threads.
    pub threads: usize,
    /// Warnings of the run.
    pub warnings: &'r [String],
    /// From the start to this record.
    pub total_seconds: f64,
    /// Peak resident memory of the process, where it is known.
    pub peak_memory_bytes: Option<u64>,
}

impl<'r> About<'r> {
    /// Of a command; what is known of its process is left out.
    pub fn new(command: &'static str, input: String, camera: &'r KnownCamera) -> Self {
        Self {
            command,
            command_line: None,
            versions: versions(),
            input,
            camera,
            preset: None,
            seed: None,
            threads: rayon::current_num_threads(),
            warnings: &[],
            total_seconds: 0.0,
            peak_memory_bytes: None,
        }
    }
}

/// The workspace's crates and their versions.
pub fn versions() -> BTreeMap<&'static str, &'static str> {
    let known = env!("MDE_VERSIONS").split_whitespace().filter_map(|pair| pair.split_once('='));
    known.chain([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]).collect()
}
