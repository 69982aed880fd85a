//! The prior's depth of every photograph.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::refinement::stages::Stages;
use crate::scene::Scene;
use crate::several::cameras::Posed;
use mde_prior::predict_each;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::{WarpConfig, forward_warp};
use ndarray::Array2;
use std::ops::ControlFlow;

/// One prediction per photograph, `[height, width]`, 0 where missing; of the reference alone for a prior that is a map. As many run at
/// once as the prior and the limits of the stages allow; the depths do not depend on it.
pub(super) fn predict(
    scene: &Scene,
    stages: &Stages<'_>,
    config: &Config,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Vec<Option<Array2<f32>>>> {
    let prior = stages.prior;
    let count = scene.photographs.len();
    let every = prior.accepts_new_images();
    let wanted: Vec<usize> = (0..count).filter(|&index| every || index == scene.reference).collect();
    let images: Vec<_> = wanted.iter().map(|&index| scene.photographs[index].image.view()).collect();
    let mut predictions = Vec::with_capacity(images.len());
    let flow = predict_each(prior, &images, stages.at_once, |prediction| {
        predictions.push(prediction);
        progress(predictions.len(), images.len())
    })?;
    if flow.is_break() {
        return Err(Error::Interrupted);
    }
    let mut depths = vec![None; count];
    for ((&index, image), prediction) in wanted.iter().zip(&images).zip(predictions) {
        let factor = stages.factors.get(index).copied().unwrap_or(1.0);
        let depth = prediction.to_depth(&config.disparity)?.mapv(|z| factor * z);
        match crate::refinement::check_prior(depth.view(), image.view()) {
            Ok(()) => depths[index] = Some(depth),
            Err(error) if index == scene.reference => return Err(error),
            // The reference's depth takes its place.
            Err(_) => {}
        }
    }
    Ok(depths)
}

/// The prior of a posed view in the unit of the poses. One without a prediction has the reference's, warped, or where that shows nothing of
/// it, the reference's median everywhere.
pub(super) fn in_unit_of_poses(posed: &Posed, priors: &[Option<Array2<f32>>], view: usize) -> Array2<f32> {
    let scaled = |depth: &Array2<f32>| depth.mapv(|z| (f64::from(z) * posed.unit) as f32);
    let (from, to) = (&posed.views[0], &posed.views[view]);
    if let Some(depth) = &priors[posed.order[view]] {
        return scaled(depth);
    }
    let reference = priors[posed.order[0]].as_ref().map(scaled).unwrap_or_default();
    let middle = median(reference.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z))).unwrap_or(1.0) as f32;
    let variance = reference.mapv(|z| if z > 0.0 { 1.0 } else { f32::INFINITY });
    let config = WarpConfig::default();
    let warped = GaussianDepth::new(reference, variance).ok().and_then(|known| {
        forward_warp(from.image.view(), &known, &from.camera, &from.pose, &to.camera, &to.pose, &config).ok()
    });
    let warped = warped.map(|warped| warped.depth).filter(|depth| depth.iter().any(|z| *z > 0.0));
    warped.unwrap_or_else(|| Array2::from_elem(to.camera.dim(), middle))
}
