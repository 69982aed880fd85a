//! The prior's depth of every photograph.

use super::Capture;
use crate::config::Config;
use crate::{Error, Result};
use mde_prior::DepthPrior;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PosedView, WarpConfig, forward_warp};
use ndarray::Array2;
use std::ops::ControlFlow;

/// One prediction per photograph, `[height, width]`, 0 where missing; of the reference alone for a prior that is a map.
pub(super) fn predict(
    capture: &Capture,
    prior: &dyn DepthPrior,
    config: &Config,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Vec<Option<Array2<f32>>>> {
    let wanted = |index: usize| index == capture.reference || prior.accepts_new_images();
    let total = (0..capture.photographs.len()).filter(|&index| wanted(index)).count();
    let mut done = 0;
    let mut depths = Vec::with_capacity(capture.photographs.len());
    for (index, photograph) in capture.photographs.iter().enumerate() {
        if !wanted(index) {
            depths.push(None);
            continue;
        }
        let depth = prior.predict(photograph.image.view())?.to_depth(&config.disparity)?;
        match crate::pipeline::check_prior(depth.view(), photograph.image.view()) {
            Ok(()) => depths.push(Some(depth)),
            Err(error) if index == capture.reference => return Err(error),
            // The reference's depth takes its place.
            Err(_) => depths.push(None),
        }
        done += 1;
        if progress(done, total).is_break() {
            return Err(Error::Interrupted);
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
