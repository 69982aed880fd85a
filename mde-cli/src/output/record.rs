//! `run.json`: the record of a run.

use crate::refiner::Refined;
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
#[derive(Serialize)]
pub struct RunRecord<'r, 's, S: Serialize> {
    /// The common part.
    #[serde(flatten)]
    pub about: About<'r>,
    /// The result without its maps.
    #[serde(flatten)]
    pub result: &'r Refined<'s>,
    /// Pixels without a refined depth.
    pub missing_pixels: usize,
    /// Curves of the fit of every iteration.
    pub training: &'r [TrainingCurve],
    /// Scores by a ground truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scores: Option<&'r S>,
    /// Of the scores.
    pub score_seconds: f64,
}

impl<'r, 's, S: Serialize> RunRecord<'r, 's, S> {
    /// Of a result without scores.
    pub fn new(about: About<'r>, result: &'r Refined<'s>, training: &'r [TrainingCurve]) -> Self {
        let variance = result.refinement.depth.variance();
        let missing_pixels = variance.iter().filter(|v| v.is_infinite()).count();
        Self { about, result, missing_pixels, training, scores: None, score_seconds: 0.0 }
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
