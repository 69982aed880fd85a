//! One iteration of the loop.

use mde_fusion::FusionReport;
use mde_nerf::FitReport;
use mde_warp::WarpReport;
use serde::Serialize;

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
