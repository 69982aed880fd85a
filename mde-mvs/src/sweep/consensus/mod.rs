//! Depth of every photograph from all of them, without a field.
//!
//! [`reconstruct`] runs the whole stage: scale, gauge, sweeps of every photograph, their agreement, and the fusion with the
//! gauged prior.

mod agreement;
mod chance;
mod fuse;
mod inflation;

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2, Zip};
use rayon::prelude::*;

pub use agreement::{Agreement, agreement};
use chance::{TRUSTED, better, chances};
use fuse::fuse;
use inflation::inflation;

use crate::raster::{enlarge, small_map, small_view};
use crate::sweep::scale::{Gauge, Match, PATCHES, Scale};
use crate::sweep::{Surfaces, Sweep, sweep, working_bytes};
use crate::{Callback, Error, Result, check_map, notify};

/// Longer side of the photographs on which scale, gauge and the smooth corrections are found.
const SMALL: usize = 160;
/// Factor by which a prior of unknown scale may be wrong.
const UNKNOWN: f64 = 32.0;

/// The factor about the scaled prior that the first sweeps cover.
const WIDE: f64 = 3.0;
/// The factor about the corrected prior that the last sweeps cover.
const NARROW: f64 = 1.5;

/// Depth of one photograph from all of them.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ViewDepth {
    /// The gauged prior: in the unit of the poses, with its variance.
    pub prior: GaussianDepth,
    /// Its own sweep.
    pub sweep: Sweep,
    /// The consensus, the sweep fused with the prior: depth and variance in the unit of the poses.
    pub fused: GaussianDepth,
    /// Counts over all other photographs.
    pub agreement: Agreement,
    /// Share of the pixels on which at least one other photograph agrees.
    pub verified: f32,
    /// Share of the variance of `fused`, but for the inflation, that is photometric ambiguity: the variance of the softmin of the sweep's
    /// costs, by the weight of the match. The rest is the prior's, and the doubt whether the match is right.
    pub ambiguity: Array2<f32>,
}

/// Result of [`reconstruct`].
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

/// Bytes that [`reconstruct`] takes, its result included, beside its inputs: the working memory of one sweep, and the maps of all
/// photographs.
pub fn reconstruct_bytes(pixels: u64, views: u64) -> u64 {
    // Of each photograph four means with variances, six maps of numbers, four of counts.
    let maps = 4 * 8 + 6 * 4 + 4;
    let working = working_bytes(pixels, views.saturating_sub(1));
    working.saturating_add(pixels.saturating_mul(views).saturating_mul(maps))
}

/// Depth and variance of every photograph, from poses, sweeps and priors.
///
/// `priors` are z-depths `[height, width]`, one for each view, in any unit (one for all); 0 where unknown. Depths come in
/// the unit of the poses. `scale`, where it is known, for example from sparse points, saves the search for it; without it
/// any factor between 1/32 and 32 is found. The callback counts the photographs as the last sweep of each ends; those before, of
/// small images, are quick.
///
/// # Errors
/// [`Error::TooFewViews`] for fewer than two views, [`Error::View`] for a map of another size than its camera,
/// [`Error::Interrupted`], and what [`sweep`] refuses.
pub fn reconstruct(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    scale: Option<Scale>,
    callback: &mut Callback<'_>,
) -> Result<Reconstruction> {
    if views.len() < 2 || priors.len() != views.len() {
        return Err(Error::TooFewViews { views: views.len().min(priors.len()) });
    }
    for (view, prior) in views.iter().zip(priors) {
        view.validate()?;
        check_map("prior", prior.dim(), &view.camera)?;
    }
    let everyone: Vec<usize> = (0..views.len()).collect();
    let small = views.iter().map(|v| small_view(v, SMALL)).collect::<Result<Vec<_>>>()?;
    let small_priors: Vec<Array2<f32>> =
        priors.iter().zip(&small).map(|(p, v)| small_map(p, v.camera.dim())).collect();

    let scale = match scale {
        Some(known) => Some(known),
        None => common_scale(&small, &small_priors)?,
    };
    let factor = scale.map_or(0.0, |s| s.log_scale).exp() as f32;

    // Gauge and smooth correction of each prior, from sweeps around the scaled prior.
    let scaled: Vec<Array2<f32>> = small_priors.iter().map(|p| p.mapv(|z| factor * z)).collect();
    let wide = everyone
        .par_iter()
        .map(|&i| {
            let surfaces = Surfaces::Around { depth: scaled[i].view(), factor: WIDE };
            sweep(&small, i, &everyone, surfaces)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = wide.iter().map(|s| &s.depth).collect();
    // The whole range, from the nearest that the prior may mean to infinity: where the prior is wrong by more.
    let whole = everyone
        .par_iter()
        .map(|&i| {
            let mut known: Vec<f64> = scaled[i].iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
            let near = quantile(&mut known, 0.01).unwrap_or(1.0) / WIDE;
            sweep(&small, i, &everyone, Surfaces::Planes { near, far: f64::INFINITY })
        })
        .collect::<Result<Vec<_>>>()?;
    let whole_depths: Vec<&GaussianDepth> = whole.iter().map(|s| &s.depth).collect();
    let common = scale.unwrap_or(Scale { log_scale: 0.0, variance: 1.0, spread: 0.3, matches: 0 });
    let corrected = |&i: &usize| -> Result<_> {
        let agreement = agreement(&small, &depths, i, &everyone)?;
        let chance = chances(&wide[i], &agreement);
        let agreement = self::agreement(&small, &whole_depths, i, &everyone)?;
        let whole_chance = chances(&whole[i], &agreement);
        let (best, chance) = better(&wide[i], &chance, &whole[i], &whole_chance)?;
        // A network's unknown shift of disparity bends the depth; one factor cannot follow it.
        let matches = matches_of(&small_priors[i], &best, &chance, i);
        let gauge = Gauge::fit(&matches).unwrap_or_else(|| Gauge::from_scale(&common));
        let prior = gauge.apply(small_priors[i].view())?;
        let fused = fuse(&small[i], &prior, &best, &chance, WIDE)?;
        // The correction is smooth, so it may be enlarged; the prior keeps its own details.
        let ratio = Zip::from(&fused.corrected).and(prior.mean()).map_collect(|&c, &p| {
            let r = (c / p).ln();
            if r.is_finite() { r } else { 0.0 }
        });
        let (h, w) = views[i].camera.dim();
        let ratio = enlarge(&ratio, h, w);
        let full = gauge.apply(priors[i])?;
        let centre = Zip::from(&ratio).and(full.mean()).map_collect(|&r, &p| p * r.exp());
        Ok((full, centre))
    };
    let corrected = everyone.par_iter().map(corrected).collect::<Result<Vec<_>>>()?;
    let (scaled, centres): (Vec<_>, Vec<_>) = corrected.into_iter().unzip();

    // The last sweeps.
    let fine = everyone
        .iter()
        .map(|&i| {
            let surfaces = Surfaces::Around { depth: centres[i].view(), factor: NARROW };
            let swept = sweep(views, i, &everyone, surfaces)?;
            notify(callback, i + 1, views.len())?;
            Ok(swept)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = fine.iter().map(|s| &s.depth).collect();
    let corrected = centres.into_iter().zip(&scaled).map(|(centre, prior)| {
        let variance = Zip::from(&centre)
            .and(prior.mean())
            .and(prior.variance())
            .map_collect(|&z, &p, &v| if p > 0.0 { v * (z / p).powi(2) } else { v });
        Ok(GaussianDepth::new(centre, variance)?)
    });
    let corrected = corrected.collect::<Result<Vec<_>>>()?;
    let corrected_depths: Vec<&GaussianDepth> = corrected.iter().collect();
    let mut fused = everyone
        .par_iter()
        .map(|&i| {
            let agreement = agreement(views, &depths, i, &everyone)?;
            let chance = chances(&fine[i], &agreement);
            let visible = self::agreement(views, &corrected_depths, i, &everyone)?.visible;
            let seen =
                Zip::from(&visible).and(fine[i].depth.mean()).map_collect(|&count, &z| count > 0 && z > 0.0);
            let map = fuse(&views[i], &corrected[i], &fine[i], &chance, NARROW)?;
            let map = map.without_unseen(&seen, &corrected[i])?;
            let confirmed = agreement.agree.iter().filter(|a| **a > 0).count();
            let verified = confirmed as f32 / agreement.agree.len() as f32;
            Ok((map, agreement, verified))
        })
        .collect::<Result<Vec<_>>>()?;
    let inflation = inflation(views, &fused);
    for (map, _, _) in &mut fused {
        map.depth = map.depth.clone().map(|m, v| (m, inflation * v));
    }
    let views = fused
        .into_iter()
        .zip(scaled)
        .zip(fine)
        .map(|((f, prior), sweep)| ViewDepth {
            prior,
            sweep,
            fused: f.0.depth,
            agreement: f.1,
            verified: f.2,
            ambiguity: f.0.ambiguity,
        })
        .collect();
    Ok(Reconstruction { scale, views, inflation })
}

/// One factor for all priors, from sweeps over every scale.
fn common_scale(views: &[PosedView], priors: &[Array2<f32>]) -> Result<Option<Scale>> {
    let everyone: Vec<usize> = (0..views.len()).collect();
    let sweeps = everyone
        .par_iter()
        .map(|&i| {
            let surfaces = Surfaces::Ladder { depth: priors[i].view(), factor: UNKNOWN };
            sweep(views, i, &everyone, surfaces)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = sweeps.iter().map(|s| &s.depth).collect();
    let mut matches = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(views, &depths, i, &everyone)?;
        matches.extend(matches_of(&priors[i], &sweeps[i], &chances(&sweeps[i], &agreement), i));
    }
    Ok(Scale::fit(&matches))
}

/// Pixels of one photograph that are probably right, each in its patch of the image.
fn matches_of(prior: &Array2<f32>, sweep: &Sweep, chance: &Array2<f32>, photograph: usize) -> Vec<Match> {
    let (h, w) = prior.dim();
    let side = (h.max(w) / PATCHES).max(1);
    prior
        .indexed_iter()
        .filter_map(|((y, x), &prior)| {
            let (depth, _) = sweep.depth.get(y, x)?;
            let weight = chance[(y, x)];
            let patch = ((photograph * 1024 + y / side) * 1024 + x / side) as u32;
            (weight > TRUSTED).then_some(Match { prior, depth, weight, patch })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::silent;
    use crate::statistics::robust_deviation;
    use crate::synthetic::room;

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

    /// Nothing in common, nothing gained: the scaled prior comes back.
    #[test]
    fn photographs_of_nothing_in_common_leave_the_prior() {
        let (mut views, _, priors) = room(1.0);
        for (i, view) in views.iter_mut().enumerate() {
            let mut state = i as u32 + 1;
            view.image.mapv_inplace(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32
            });
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
    fn too_few_views_are_named() {
        let (views, _, priors) = room(1.0);
        let found = reconstruct(&views[..1], &[priors[0].view()], None, &mut silent);
        assert_eq!(found, Err(Error::TooFewViews { views: 1 }));
    }
}
