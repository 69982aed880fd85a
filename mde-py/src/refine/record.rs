//! The record of a run, `run.json`.

use super::camera::KnownCamera;
use crate::prior::Origin;
use mde_cli::mde_nerf::FieldEvent;
use mde_cli::mde_prior::DepthKind;
use mde_cli::mde_uncertainty::statistics::quantile;
use mde_cli::{AugmentationReport, CaptureReport, Config, IterationReport};
use ndarray::Array2;
use serde::Serialize;
use std::collections::BTreeMap;

/// Share of the pixels above which missing depth is a sign of a wrong model.
const MISSING: f64 = 0.3;
/// Ratio of the depths' 95 and 5 % quantiles below which a map is nearly constant.
const RANGE: f64 = 1.03;

/// The record, with the program's keys.
#[derive(Serialize)]
pub(crate) struct Record<'r> {
    pub(crate) command: &'static str,
    pub(crate) versions: BTreeMap<&'static str, &'static str>,
    pub(crate) input: &'r str,
    pub(crate) camera: &'r KnownCamera,
    pub(crate) preset: &'static str,
    pub(crate) seed: u64,
    pub(crate) threads: usize,
    pub(crate) warnings: &'r [String],
    pub(crate) total_seconds: f64,
    pub(crate) prior: &'r Origin,
    pub(crate) unit: &'static str,
    pub(crate) png_scale: f64,
    pub(crate) png_missing_pixels: usize,
    pub(crate) missing_pixels: usize,
    pub(crate) augmentation: &'r AugmentationReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) capture: Option<&'r CaptureReport>,
    pub(crate) iterations: &'r [IterationReport],
    pub(crate) training: &'r [TrainingCurve],
    pub(crate) prior_seconds: f64,
}

/// Curves of a fit, one entry per event.
#[derive(Debug, Default, Serialize)]
pub(crate) struct TrainingCurve {
    step: Vec<usize>,
    loss: Vec<f64>,
    psnr: Vec<f64>,
}

/// Adds an event to the curves; `iteration` is from 0.
pub(crate) fn follow(curves: &mut Vec<TrainingCurve>, iteration: usize, event: &FieldEvent) {
    let FieldEvent::Fit { step, loss, psnr, .. } = *event else { return };
    curves.resize_with((iteration + 1).max(curves.len()), Default::default);
    if let Some(curve) = curves.last_mut() {
        curve.step.push(step);
        curve.loss.push(loss);
        curve.psnr.push(psnr);
    }
}

/// Warnings about the depth that a model gave, 0 where missing.
pub(crate) fn doubts(depth: &Array2<f32>, origin: &Origin, config: &Config) -> Vec<String> {
    let mut warnings = Vec::new();
    let name = &origin.source;
    let mut known: Vec<f64> = depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
    let missing = 1.0 - known.len() as f64 / depth.len().max(1) as f64;
    if missing > MISSING {
        warnings.push(format!(
            "{name}: no depth for {:.0} % of the pixels; check its profile, kind and weights",
            100.0 * missing
        ));
    }
    if let (Some(low), Some(high)) = (quantile(&mut known, 0.05), quantile(&mut known, 0.95))
        && high < RANGE * low
    {
        warnings.push(format!(
            "{name}: its depth is nearly constant, {low:.3} to {high:.3}; check its profile, kind and weights"
        ));
    }
    if origin.kind == DepthKind::AffineDisparity {
        warnings.push(format!(
            "{name} gives disparity of unknown scale and shift: depths of {} to {} are assumed; set disparity.near and disparity.far",
            config.disparity.near, config.disparity.far
        ));
    }
    warnings
}
