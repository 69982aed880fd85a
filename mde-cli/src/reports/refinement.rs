//! The maps of a refinement, and what its iterations found.

use crate::error::{Error, Result};
use crate::reports::{AugmentationReport, CaptureReport, Component, PoseSource};
use mde_fusion::FusionReport;
use mde_nerf::{FitReport, RadianceField};
use mde_prior::Certainty;
use mde_uncertainty::GaussianDepth;
use mde_warp::WarpReport;
use ndarray::Array2;
use serde::Serialize;

/// Result of a run; serialised, without the maps and the field.
#[derive(Serialize)]
pub struct Refinement {
    /// The refined depth and its variance, `[height, width]`, z in the prior's unit.
    #[serde(skip)]
    pub depth: GaussianDepth,
    /// The monocular depth that it started from, `[height, width]`; 0 where missing.
    #[serde(skip)]
    pub prior: Array2<f32>,
    /// Report of the prior's stage.
    pub augmentation: AugmentationReport,
    /// Components of the standard deviation.
    #[serde(skip)]
    pub components: Vec<Component>,
    /// One report per iteration.
    pub iterations: Vec<IterationReport>,
    /// The field of the last iteration, if there was one.
    #[serde(skip)]
    pub field: Option<Box<dyn RadianceField>>,
    /// How sure the model itself is of each pixel, where it says so and refined a single photograph. Sigma does not depend on it.
    #[serde(skip)]
    pub certainty: Option<Certainty>,
    /// Report of several photographs, where there were any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture: Option<CaptureReport>,
}

impl Refinement {
    /// Nothing but the prior and a single prediction.
    pub(crate) fn of_prior(prior: Array2<f32>) -> Self {
        let (height, width) = prior.dim();
        Self {
            depth: GaussianDepth::missing(height, width),
            prior,
            augmentation: AugmentationReport { predictions: 1, ..AugmentationReport::default() },
            components: Vec::new(),
            iterations: Vec::new(),
            field: None,
            certainty: None,
            capture: None,
        }
    }

    /// The same in the unit of the capture's poses instead of the prior's: depth, prior, components and variance.
    ///
    /// # Errors
    /// [`Error::Capture`] where the poses have no unit of their own, or no scale between it and the prior was found.
    pub fn in_capture_unit(self) -> Result<Self> {
        let remedy = "give a capture with poses, or keep the unit of the prior";
        let fault = |reason: &str| Error::Capture { reason: reason.to_owned(), remedy };
        let report = self.capture.as_ref().filter(|report| report.poses != PoseSource::Estimated);
        let Some(report) = report else {
            return Err(fault("the poses were estimated, so the capture has no unit but the prior's"));
        };
        let factor = match report.scale {
            Some([factor, _]) if factor > 0.0 && factor.is_finite() => f64::from(factor as f32),
            _ => return Err(fault("no scale between the capture's unit and the prior's was found")),
        };
        let refined = self.mapped(None, |z| Some((factor * z, factor, 0.0)))?.0;
        Ok(refined.with_poses(Some(factor)))
    }
}

/// Report of one iteration of the loop.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct IterationReport {
    /// Report of the synthetic views.
    pub warp: WarpReport,
    /// Report of the field's fit; its first PSNR is that of the original view.
    pub fit: FitReport,
    /// Estimates of the fusion.
    pub fusion: FusionReport,
    /// Spearman's correlation of the field's aggregated depth with the fusion's prior, over the pixels known to both.
    pub field_prior_spearman: Option<f64>,
    /// Median of \\(|D_r / D_o - 1|\\) over the same pixels, before the affine map.
    pub field_prior_deviation: Option<f64>,
    /// Wall seconds by stage.
    pub seconds: StageSeconds,
}

/// Wall seconds by stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct StageSeconds {
    /// Making the synthetic views.
    pub warp: f64,
    /// Fitting the field.
    pub fit: f64,
    /// Rendering and reprojecting the novel views.
    pub render: f64,
    /// Fusing.
    pub fuse: f64,
}
