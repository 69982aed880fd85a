//! The prior's depth of every photograph.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::refinement::stages::Stages;
use crate::scene::Scene;
use mde_prior::predict_each;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PosedView, WarpConfig, forward_warp};
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

/// The priors of `views` in one unit. Photographs without a prediction get the reference's, warped; `unit` is the capture's unit per
/// unit of the prior.
pub(super) fn for_views(
    views: &[PosedView],
    order: &[usize],
    priors: &[Option<Array2<f32>>],
    unit: f64,
) -> Result<Vec<Array2<f32>>> {
    let scaled = |depth: &Array2<f32>| depth.mapv(|z| (f64::from(z) * unit) as f32);
    let reference = order.first().and_then(|&i| priors[i].as_ref()).map(scaled).ok_or(Error::EmptyPrior)?;
    let variance = reference.mapv(|z| if z > 0.0 { 1.0 } else { f32::INFINITY });
    let known = GaussianDepth::new(reference, variance)?;
    let from = &views[0];
    views
        .iter()
        .zip(order)
        .map(|(view, &index)| match &priors[index] {
            Some(depth) => Ok(scaled(depth)),
            None => {
                let warped = forward_warp(
                    from.image.view(),
                    &known,
                    &from.camera,
                    &from.pose,
                    &view.camera,
                    &view.pose,
                    &WarpConfig::default(),
                )?;
                Ok(warped.depth)
            }
        })
        .collect()
}
