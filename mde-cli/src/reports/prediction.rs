//! The prior's stage: what was predicted, and the parts of the standard deviation.

use mde_prior::augment::Plan;
use ndarray::Array2;
use serde::Serialize;

/// A part of the refined depth's standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// `spread`: of the predictions. `disagreement`: between the merged map and the prediction of the whole image. `common`: the
    /// stated error that all predictions share. `field`: of the rays' termination over all views, in the prior's gauge. Those of several
    /// photographs are in `docs/outputs.md`.
    pub name: &'static str,
    /// `[height, width]`, in the depth's unit; infinite where missing.
    pub sigma: Array2<f32>,
}

/// Report of the prior's stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct AugmentationReport {
    /// Number of inference calls.
    pub predictions: usize,
    /// The images that were predicted, where the model accepts any.
    pub plan: Option<Plan>,
    /// Why it is this plan.
    pub reason: Option<String>,
    /// The reason for fewer predictions than the settings name.
    pub fewer: Option<String>,
    /// Median spread of the predictions, as a fraction of the depth.
    pub median_spread: Option<f64>,
    /// Stated error that all predictions share, as a fraction of the depth.
    pub common_error: Option<f64>,
    /// Median of \\(|\ln z - \ln z_o|\\): the change by the augmentation.
    pub median_change: Option<f64>,
    /// Wall seconds.
    pub seconds: f64,
}
