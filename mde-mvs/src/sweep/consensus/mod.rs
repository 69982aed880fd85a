//! Depth of every photograph from all of them, without a field.
//!
//! [`Sweeps`] has the whole stage: scale, gauge, sweeps of every photograph, their agreement, and the fusion with the
//! gauged prior, for a capture of any length; [`reconstruct`] is the same for a few photographs at once.

mod agreement;
mod chance;
mod fuse;
mod sweeps;

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{ArcArray2, Array2, ArrayView2};
use std::sync::Arc;

pub use agreement::{Agreement, agreement};
use chance::TRUSTED;
pub use sweeps::{ReadPrior, ReadView, Sweeps, sweeps_bytes};

use crate::sweep::Sweep;
use crate::sweep::scale::{Match, Scale, patch};
use crate::{Callback, Error, Result};

/// Depth of one photograph from all of them.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ViewDepth {
    /// The gauged prior: in the unit of the poses, with its variance.
    pub prior: GaussianDepth,
    /// The consensus, the sweep fused with the prior: depth and variance in the unit of the poses.
    pub fused: GaussianDepth,
    /// Counts over its sources.
    pub agreement: Arc<Agreement>,
    /// Share of the pixels on which at least one source agrees.
    pub verified: f32,
    /// Share of the variance of `fused`, but for the inflation, that is photometric ambiguity: the variance of the softmin of the sweep's
    /// costs, by the weight of the match. The rest is the prior's, and the doubt whether the match is right.
    pub ambiguity: ArcArray2<f32>,
}

/// Result of [`reconstruct`] and [`Sweeps::reconstruct`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Reconstruction {
    /// The common factor of the priors; nothing where the photographs agree on none.
    pub scale: Option<Scale>,
    /// One for each view.
    pub views: Vec<ViewDepth>,
    /// Factor, at least 1, by which the variances of `fused` were enlarged, so that they explain how far the photographs disagree.
    pub inflation: f32,
}

/// Depth and variance of every photograph, from poses, sweeps and priors: the [`Sweeps`] of photographs that all see the same.
///
/// `priors` are z-depths `[height, width]`, one for each view, in any unit (one for all); 0 where unknown. Depths come in the unit of the
/// poses. `scale`, where it is known, for example from sparse points, saves the search for it; without it any factor between 1/32 and 32 is
/// found. The callback counts the photographs as the last sweep of each ends; those before, of small images, are quick.
///
/// # Errors
/// [`Error::TooFewViews`] for fewer than two views, [`Error::View`] for a map of another size than its camera,
/// [`Error::Interrupted`], and what [`sweep`](crate::sweep::sweep) refuses.
pub fn reconstruct(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    scale: Option<Scale>,
    callback: &mut Callback<'_>,
) -> Result<Reconstruction> {
    if views.len() < 2 || priors.len() != views.len() {
        return Err(Error::TooFewViews { views: views.len().min(priors.len()) });
    }
    let everyone: Vec<usize> = (0..views.len()).collect();
    let (view, prior) = (|i: usize| Ok(views[i].clone()), |i: usize| priors[i].to_owned());
    let mut sweeps = Sweeps::new(&view, &prior, vec![everyone.clone(); views.len()])?;
    match scale {
        Some(known) => sweeps.scale = Some(known),
        None => sweeps.find_scale(&everyone)?,
    }
    sweeps.reconstruct(&view, &prior, &everyone, callback)
}

/// Pixels of one photograph that are probably right, each in its patch of the image.
fn matches_of(prior: &Array2<f32>, sweep: &Sweep, chance: &Array2<f32>, photograph: usize) -> Vec<Match> {
    let found = prior.indexed_iter().filter_map(|(at, &own)| {
        let (depth, _) = sweep.depth.get(at.0, at.1)?;
        let (weight, patch) = (chance[at], patch(prior.dim(), at, photograph));
        (weight > TRUSTED).then_some(Match { prior: own, depth, weight, patch })
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silent;
    use crate::statistics::robust_deviation;
    use crate::synthetic::{Plane, room, scene};
    use mde_uncertainty::random::CounterRng;
    use mde_uncertainty::statistics::median;
    use nalgebra::Vector3;
    use ndarray::Zip;
    use rand::RngExt;

    fn error(map: ArrayView2<'_, f32>, truth: &Array2<f32>) -> f64 {
        let sum: f64 = map.iter().zip(truth).map(|(z, t)| f64::from((z / t - 1.0).abs())).sum();
        sum / truth.len() as f64
    }

    #[test]
    fn the_scale_is_found_and_the_prior_corrected() {
        let (views, depths, priors) = room(0.13);
        let maps: Vec<_> = priors.iter().map(|p| p.view()).collect();
        let found = reconstruct(&views, &maps, None, &mut silent).unwrap();
        let scale = found.scale.unwrap().log_scale.exp();
        assert!((scale * 0.13 - 1.0).abs() < 0.15, "scale {scale}");
        for (view, truth) in found.views.iter().zip(&depths) {
            let (scaled, fused) = (error(view.prior.mean(), truth), error(view.fused.mean(), truth));
            assert!(scaled > 0.05 && fused < 0.5 * scaled, "{scaled} {fused}");
            assert!(view.verified > 0.5);
        }
        // The same unit given from outside saves the search and changes little.
        let known = reconstruct(&views, &maps, found.scale, &mut silent).unwrap();
        assert!(error(known.views[0].fused.mean(), &depths[0]) < 0.04);
    }

    /// A floor that begins at a sixth of a constant prior before a wall.
    #[test]
    fn near_things_are_found_without_a_prior_s_shape() {
        let planes = [Plane::slanted(3.0, 0.0, 0.0), Plane { normal: Vector3::y(), offset: 0.2 }];
        let centres = [[0.0; 3], [0.05, 0.0, 0.0], [-0.05, 0.02, 0.0], [0.02, -0.05, 0.0]];
        let (views, depths) = scene(&planes, (72, 96), &centres);
        let prior = Array2::from_elem((72, 96), 3.0_f32);
        let scale = Scale { log_scale: 0.0, variance: 1e-4, spread: 0.3, matches: 100 };
        let found = reconstruct(&views, &[prior.view(); 4], Some(scale), &mut silent).unwrap();
        let map = found.views[0].fused.mean();
        let pairs = map.iter().zip(&depths[0]);
        let near: Vec<f64> =
            pairs.filter(|(_, t)| **t < 0.6).map(|(z, t)| f64::from((z / t - 1.0).abs())).collect();
        let error = median(near.iter().copied()).unwrap();
        assert!(near.len() > 500 && error < 0.05, "{} {error}", near.len());
    }

    /// Nothing in common, nothing gained: the scaled prior comes back.
    #[test]
    fn photographs_of_nothing_in_common_leave_the_prior() {
        let (mut views, _, priors) = room(1.0);
        for (i, view) in views.iter_mut().enumerate() {
            let mut random = CounterRng::new(0, "noise", 0, i as u64);
            view.image.mapv_inplace(|_| random.random());
        }
        let maps: Vec<_> = priors.iter().map(|p| p.view()).collect();
        let found = reconstruct(&views, &maps, None, &mut silent).unwrap();
        let view = &found.views[0];
        assert!(view.verified < 0.3, "{}", view.verified);
        let ratio = Zip::from(view.fused.mean()).and(&priors[0]).map_collect(|z, p| f64::from((z / p).ln()));
        let spread = robust_deviation(ratio.iter().map(|r| r - ratio.mean().unwrap()));
        assert!(spread.unwrap() < 0.2, "{spread:?}");
    }

    #[test]
    fn a_result_does_not_depend_on_those_before_it() {
        let (views, _, priors) = room(1.0);
        let (view, prior) = (|i: usize| Ok(views[i].clone()), |i: usize| priors[i].clone());
        let last_of = |results: &[&[usize]]| {
            let sources = vec![vec![0, 1], vec![0, 1, 2], vec![1, 2, 3], vec![2, 3]];
            let mut sweeps = Sweeps::new(&view, &prior, sources).unwrap();
            let result =
                |members: &&[usize]| sweeps.reconstruct(&view, &prior, members, &mut silent).unwrap();
            results.iter().map(result).last().unwrap()
        };
        assert_eq!(last_of(&[&[0, 1], &[2, 1, 3]]), last_of(&[&[2, 1, 3]]));
    }

    #[test]
    fn too_few_views_are_named() {
        let (views, _, priors) = room(1.0);
        let found = reconstruct(&views[..1], &[priors[0].view()], None, &mut silent);
        assert_eq!(found, Err(Error::TooFewViews { views: 1 }));
    }
}
