//! What stands in for a radiance field when the question is what the field adds.

use mde_fusion::{Aggregation, aggregate};
use mde_nerf::{Error, FitReport, Observer, RadianceField, RenderedView, Result};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use ndarray::Array3;

/// Standard deviation that it states, as a fraction of the depth: what the termination of rays typically gives.
const RELATIVE_SIGMA: f64 = 0.05;

fn fault(error: &dyn std::fmt::Display) -> Error {
    Error::View { index: 0, reason: error.to_string() }
}

fn uncoloured(depth: GaussianDepth, camera: &PinholeCamera) -> RenderedView {
    let opacity = depth.support().mapv(|known| f32::from(u8::from(known)));
    RenderedView { image: Array3::zeros((camera.height, camera.width, 3)), depth, opacity }
}

/// A field that fits nothing: the depth of a pixel is the precision-weighted mean of all views' hypotheses, reprojected, and its
/// variance that of their mixture.
///
/// A hypothesis that states no variance counts with a standard deviation of 5 %. It is the plain average that a field has to beat.
#[derive(Default)]
pub struct AveragedField {
    views: Vec<PosedView>,
}

impl RadianceField for AveragedField {
    fn fit(&mut self, views: &[PosedView], _: &mut dyn Observer) -> Result<FitReport> {
        if views.iter().all(|view| view.hypotheses.is_empty()) {
            return Err(Error::NoRange);
        }
        self.views = views.to_vec();
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut dyn Observer) -> Result<RenderedView> {
        let mut seen = Vec::new();
        for view in &self.views {
            for hypothesis in &view.hypotheses {
                let stated = hypothesis.clone().map(|mean, variance| match variance > 0.0 {
                    true => (mean, variance),
                    false => (mean, (RELATIVE_SIGMA * f64::from(mean)).powi(2) as f32),
                });
                let rules = ReprojectConfig::default();
                let there = if (&view.camera, &view.pose) == (camera, pose) {
                    stated
                } else {
                    reproject(&stated, &view.camera, &view.pose, camera, pose, &rules)
                        .map_err(|e| fault(&e))?
                };
                seen.push(there);
            }
        }
        if seen.is_empty() {
            return Err(Error::NotFitted);
        }
        let depth = aggregate(&seen, Aggregation::Precision, true).map_err(|e| fault(&e))?;
        Ok(uncoloured(depth, camera))
    }
}
