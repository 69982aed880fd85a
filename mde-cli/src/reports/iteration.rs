//! One iteration of the loop.

use mde_fusion::FusionReport;
use mde_nerf::FitReport;
use mde_warp::WarpedView;
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

/// Coverage of the synthetic views.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct WarpReport {
    /// Number of views.
    pub views: usize,
    /// Mean share of a view's pixels that are holes: within the source image, but of a surface that it does not show. They are filled and masked.
    pub mean_hole_fraction: f64,
    /// Largest share of any view.
    pub max_hole_fraction: f64,
    /// Mean share of a view's pixels outside of the source image.
    pub mean_outside_fraction: f64,
}

impl WarpReport {
    /// Adds a view.
    pub(crate) fn add(&mut self, view: &WarpedView) {
        let mean = |old: f64, new: f64| (old * self.views as f64 + new) / (self.views + 1) as f64;
        self.mean_hole_fraction = mean(self.mean_hole_fraction, view.hole_fraction);
        self.mean_outside_fraction = mean(self.mean_outside_fraction, view.outside_fraction);
        self.max_hole_fraction = self.max_hole_fraction.max(view.hole_fraction);
        self.views += 1;
    }
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
