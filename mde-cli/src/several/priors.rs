//! The prior's depth of every photograph.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::refinement::check_prior;
use crate::refinement::stages::Stages;
use crate::scene::Scene;
use crate::several::cameras::Posed;
use mde_prior::pixels::RECENT;
use mde_prior::predict_each;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::{WarpConfig, forward_warp};
use ndarray::{ArcArray2, Array2, Array3};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// One prediction per photograph that has a usable one, `[height, width]`, 0 where missing; of the first alone for a prior that is a
/// map. As many run at once as the prior and the limits of the stages allow; the depths do not depend on it.
pub(super) fn predict(
    scene: &Scene,
    stages: &Stages<'_>,
    config: &Config,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Vec<Option<ArcArray2<f32>>>> {
    let count = scene.photographs.len();
    let every = stages.prior.accepts_new_images();
    let wanted: Vec<usize> = (0..count).filter(|&index| every || index == 0).collect();
    let (mut depths, mut done, mut fault) = (vec![None; count], 0, None);
    for part in wanted.chunks(RECENT) {
        let images = part.par_iter().map(|&index| scene.photographs[index].image.read());
        let images = images.collect::<mde_prior::Result<Vec<_>>>()?;
        let views: Vec<_> = images.iter().map(|image| image.view()).collect();
        let flow = predict_each(stages.prior, &views, stages.at_once, |prediction| {
            let index = wanted[done];
            let factor = stages.factors.get(index).copied().unwrap_or(1.0);
            let depth = prediction.and_then(|prediction| prediction.to_depth(&config.disparity));
            let checked = depth.map_err(Error::from).and_then(|mut depth| {
                depth.mapv_inplace(|z| factor * z);
                check_prior(depth.view(), scene.photographs[index].size())?;
                Ok(depth)
            });
            match checked {
                Ok(depth) => depths[index] = Some(shared(depth, &depths[..index])),
                Err(error) => _ = fault.get_or_insert(error),
            }
            done += 1;
            progress(done, wanted.len())
        })?;
        if flow.is_break() {
            return Err(Error::Interrupted);
        }
    }
    let missing = if scene.every { depths.iter().all(Option::is_none) } else { depths[0].is_none() };
    fault.filter(|_| missing).map_or(Ok(depths), Err)
}

/// A depth, in the memory of the one before it where they are the same, as without a network.
fn shared(depth: Array2<f32>, before: &[Option<ArcArray2<f32>>]) -> ArcArray2<f32> {
    let same = before.iter().rev().flatten().next().filter(|other| **other == depth);
    same.cloned().unwrap_or_else(|| depth.into_shared())
}

/// The prior of a posed view in the unit of the poses. One without a prediction has that of the first with one, warped, or where that
/// shows nothing of it, its median everywhere.
pub(super) fn in_unit_of_poses(posed: &Posed, priors: &[Option<ArcArray2<f32>>], view: usize) -> Array2<f32> {
    let scaled =
        |depth: &ArcArray2<f32>| depth.mapv(|z| (f64::from(z) * posed.unit * posed.own[view]) as f32);
    if let Some(depth) = &priors[posed.order[view]] {
        return scaled(depth);
    }
    let first = (0..posed.views.len()).find(|first| priors[posed.order[*first]].is_some()).unwrap_or(0);
    let (from, to) = (&posed.views[first], &posed.views[view]);
    let reference = priors[posed.order[first]].as_ref().map(scaled).unwrap_or_default();
    let middle = median(reference.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z))).unwrap_or(1.0) as f32;
    let variance = reference.mapv(|z| if z > 0.0 { 1.0 } else { f32::INFINITY });
    let config = WarpConfig::default();
    let warped = GaussianDepth::new(reference, variance).ok().and_then(|known| {
        // Of what comes back the depth alone is used.
        let image = Array3::zeros((from.camera.height, from.camera.width, 3));
        forward_warp(image.view(), &known, &from.camera, &from.pose, &to.camera, &to.pose, &config).ok()
    });
    let warped = warped.map(|warped| warped.depth).filter(|depth| depth.iter().any(|z| *z > 0.0));
    warped.unwrap_or_else(|| Array2::from_elem(to.camera.dim(), middle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_depths_stand_in_one_memory() {
        let of = |z: f32, before: &[_]| Some(shared(Array2::from_elem((3, 4), z), before));
        let mut depths = vec![of(2.0, &[]), None];
        for (z, same) in [(2.0, true), (3.0, false), (3.0, true)] {
            depths.push(of(z, &depths));
            let mut last = depths.iter().rev().flatten().map(|depth| depth.as_ptr());
            assert_eq!(last.next() == last.next(), same, "{z}");
        }
    }
}
