//! A filter in place of the field.

use mde_eval::{Method, Task};
use mde_nerf::{Error, FieldCallback, FitReport, RadianceField, RenderedView, Result};
use mde_prior::DisparityRule;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use ndarray::Array3;
use std::sync::Arc;

/// Standard deviation as a fraction of the depth, typical of the termination of rays.
const RELATIVE_SIGMA: f64 = 0.05;

/// A field without a fit: the depth of the first view after a [`mde_eval::Method`] (a filter, or noise), reprojected.
///
/// Its standard deviation is 5 % of the depth. In place of a NeRF, it shows what the same fusion gains with a plain filter.
pub(crate) struct FilteredField {
    refiner: Arc<dyn Method + Send + Sync>,
    seed: u64,
    view: Option<(PosedView, GaussianDepth)>,
}

impl FilteredField {
    /// A field whose depth is what `refiner` makes of the first view's.
    pub(crate) fn new(refiner: Arc<dyn Method + Send + Sync>, seed: u64) -> Self {
        Self { refiner, seed, view: None }
    }
}

fn fault(error: &dyn std::fmt::Display) -> Error {
    Error::View { index: 0, reason: error.to_string() }
}

impl RadianceField for FilteredField {
    fn fit(&mut self, views: &[PosedView], _: &mut dyn FieldCallback) -> Result<FitReport> {
        let view = views.first().ok_or(Error::NoPixels)?;
        let depth = view.hypotheses.first().ok_or(Error::NoRange)?;
        let known = depth.support();
        let mut prior = depth.mean().to_owned();
        prior.zip_mut_with(&known, |d, known| *d = if *known { *d } else { 0.0 });
        let rule = DisparityRule::default();
        let task =
            Task { seed: self.seed, ..Task::new(view.image.view(), &view.camera, prior.view(), &rule) };
        let refined = self.refiner.refine(&task).map_err(|e| fault(&e))?.depth;
        let variance = refined
            .mapv(|d| if d > 0.0 { (RELATIVE_SIGMA * f64::from(d)).powi(2) as f32 } else { f32::INFINITY });
        let depth = GaussianDepth::new(refined, variance).map_err(|e| fault(&e))?;
        self.view = Some((view.clone(), depth));
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut dyn FieldCallback) -> Result<RenderedView> {
        let (view, depth) = self.view.as_ref().ok_or(Error::NotFitted)?;
        let depth = reproject(depth, &view.camera, &view.pose, camera, pose, &ReprojectConfig::default())
            .map_err(|e| fault(&e))?;
        Ok(uncoloured(depth, camera))
    }
}

fn uncoloured(depth: GaussianDepth, camera: &PinholeCamera) -> RenderedView {
    let opacity = depth.support().mapv(|known| f32::from(u8::from(known)));
    RenderedView { image: Array3::zeros((camera.height, camera.width, 3)), depth, opacity, in_bin: None }
}
