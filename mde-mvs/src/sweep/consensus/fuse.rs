//! A sweep and the scaled prior as one map, and by how much the variances of such maps are too small.

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use mde_warp::transfer::Transfer;
use ndarray::{Array2, Zip};
use rayon::prelude::*;

use super::chance::TRUSTED;
use super::sweeps::Map;
use crate::Result;
use crate::raster::luma;
use crate::statistics::robust_deviation;
use crate::sweep::Sweep;
use crate::sweep::correction::correct;
use crate::sweep::edge::own_contrast;

/// Share of the photograph that matches must cover for their deviation to count as much as the range of the surfaces: on a plain wall few
/// pixels match, all in the middle of the range.
const COVERED: f32 = 0.005;

/// The sweep of a photograph and its scaled prior as one map: the prior's smooth error is corrected by the sweep, then
/// both are fused by precision, the sweep being right with a probability only.
pub(super) struct Fused {
    pub(super) depth: GaussianDepth,
    /// Probability that the sweep is right.
    pub(super) inlier: Array2<f32>,
    /// The prior after the correction.
    pub(super) corrected: Array2<f32>,
    /// Share of the variance that the sweep's own is.
    pub(super) ambiguity: Array2<f32>,
}

impl Fused {
    /// Leaves the corrected prior where no other photograph contains the point, with the variance of the prior at least: the correction
    /// is extrapolated there.
    pub(super) fn without_unseen(mut self, seen: &Array2<bool>, prior: &GaussianDepth) -> Result<Self> {
        let (mut mean, mut variance) = self.depth.into_parts();
        for (at, _) in seen.indexed_iter().filter(|(_, seen)| !**seen) {
            let Some((z, v)) = prior.get(at.0, at.1).filter(|(z, _)| *z > 0.0) else { continue };
            let corrected = self.corrected[at];
            let least = v * (corrected / z).powi(2);
            variance[at] = (variance[at] * (corrected / mean[at]).powi(2)).max(least);
            mean[at] = corrected;
            (self.inlier[at], self.ambiguity[at]) = (0.0, 0.0);
        }
        self.depth = GaussianDepth::new(mean, variance)?;
        Ok(self)
    }
}

pub(super) fn fuse(
    view: &PosedView,
    prior: &GaussianDepth,
    sweep: &Sweep,
    chance: &Array2<f32>,
    factor: f64,
) -> Result<Fused> {
    let shape = prior.dim();
    let log_prior = prior.mean().mapv(|z| if z > 0.0 { z.ln() } else { f32::NAN });
    let residual = Zip::from(&log_prior).and(sweep.depth.mean()).map_collect(|&p, &z| {
        let r = if z > 0.0 { z.ln() - p } else { 0.0 };
        if r.is_finite() { r } else { 0.0 }
    });
    let known = |y, x| sweep.depth.get(y, x).filter(|(z, _)| *z > 0.0 && log_prior[(y, x)].is_finite());
    // A plain surface beside another has that one's depth, in all photographs alike.
    let own = own_contrast(view);
    let weight = Array2::from_shape_fn(shape, |at| {
        let trusted = chance[at] > TRUSTED && known(at.0, at.1).is_some();
        if trusted { chance[at] * own[at] } else { 0.0 }
    });
    let matched = residual.iter().zip(&weight).filter(|(_, w)| **w > 0.0).map(|(r, _)| f64::from(*r));
    let matched = robust_deviation(matched).unwrap_or(0.0).clamp(0.02, 1.0) as f32;
    let (covered, range) = (weight.sum() / weight.len() as f32, factor.ln() as f32);
    // Even values from -a to a have the variance a^2 / 3.
    let variance = (covered * matched.powi(2) + COVERED * range.powi(2) / 3.0) / (covered + COVERED);
    let filled = log_prior.mapv(|p| if p.is_finite() { p } else { 0.0 });
    let field = correct(&residual, &weight, [&luma(view.image.view()), &filled], variance.sqrt());
    // A wrong match lies anywhere among the surfaces.
    let anywhere = 1.0 / (2.0 * range);
    let [mut mean, mut inlier, mut corrected, mut ambiguity] = [(); 4].map(|()| Array2::zeros(shape));
    let mut variance = Array2::from_elem(shape, f32::INFINITY);
    for (at, &p) in log_prior.indexed_iter() {
        if !p.is_finite() {
            if let Some((z, v)) = sweep.depth.get(at.0, at.1) {
                (mean[at], variance[at], inlier[at], ambiguity[at]) = (z, v, chance[at], 1.0);
            }
            continue;
        }
        let (u, s) = (field.mean[at], field.variance[at]);
        let (mut m, mut v) = (u, s);
        if let Some((z, var)) = known(at.0, at.1) {
            let (r, var) = (residual[at], var / (z * z));
            let total = s + var;
            let density = (-0.5 * (r - u).powi(2) / total).exp() / (std::f32::consts::TAU * total).sqrt();
            let good = chance[at] * density;
            let probability = good / (good + (1.0 - chance[at]) * anywhere).max(1e-20);
            let gain = s / total;
            let (m1, v1) = (u + gain * (r - u), gain * var);
            m = probability * m1 + (1.0 - probability) * u;
            v = probability * (v1 + (m1 - m).powi(2)) + (1.0 - probability) * (s + (u - m).powi(2));
            inlier[at] = probability;
            // Of the fused variance (1 - gain)^2 s + gain^2 var.
            ambiguity[at] = if v > 0.0 { (probability * gain * gain * var / v).min(1.0) } else { 0.0 };
        }
        let z = (p + m).exp();
        (mean[at], variance[at]) = (z, z * z * v);
        corrected[at] = (p + u).exp();
    }
    Ok(Fused { depth: GaussianDepth::new(mean, variance)?, inlier, corrected, ambiguity })
}

/// Factor on the variances, at least 1, that makes them consistent with the differences between photographs.
///
/// Matches of neighbours share their errors, so that variances which take them as independent are too small. Where two
/// verified maps meet, 90 % of the differences should lie within 1.645 standard deviations.
pub(super) fn inflation(maps: &[(&PosedView, &Map)]) -> f32 {
    let pairs = (0..maps.len()).flat_map(|i| (0..maps.len()).map(move |j| (i, j)));
    let pairs: Vec<(usize, usize)> = pairs.filter(|(i, j)| i != j).collect();
    let mut scores: Vec<f64> = pairs
        .par_iter()
        .flat_map_iter(|&(i, j)| {
            let carried = splat(maps[j], maps[i].0);
            let (own, agreement) = (&maps[i].1.depth, &maps[i].1.agreement.agree);
            let score = |((y, x), &(log, v)): ((usize, usize), &(f32, f32))| {
                let (z, variance) = own.get(y, x).filter(|(z, _)| *z > 0.0)?;
                let seen = v.is_finite() && agreement[(y, x)] > 0;
                let total = v + variance / (z * z);
                (seen && total > 0.0).then(|| f64::from((log - z.ln()).powi(2) / total))
            };
            carried.indexed_iter().step_by(7).filter_map(score).collect::<Vec<_>>()
        })
        .collect();
    let high = quantile(&mut scores, 0.9).unwrap_or(1.0);
    (high / 1.645_f64.powi(2)).clamp(1.0, 1e4) as f32
}

/// Log depth and its variance of one view's verified pixels seen from another, the nearest where several land.
fn splat((from, map): (&PosedView, &Map), to: &PosedView) -> Array2<(f32, f32)> {
    let transfer = Transfer::new(from, to);
    let mut out = Array2::from_elem(to.camera.dim(), (f32::INFINITY, f32::INFINITY));
    for ((y, x), &z) in map.depth.mean().indexed_iter() {
        let v = map.depth.variance()[(y, x)];
        if !(map.sure[(y, x)] && z > 0.0 && v.is_finite()) {
            continue;
        }
        let Some(seen) = transfer.at(x as f64, y as f64, 1.0 / f64::from(z)) else { continue };
        let Some(at) = transfer.nearest(&seen) else { continue };
        let there = (f64::from(z) * seen.ratio).ln() as f32;
        if there < out[at].0 {
            out[at] = (there, v / (z * z));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::consensus::chance::tests::sure;
    use crate::synthetic::room;

    /// A view, and a prior that is 1 everywhere.
    fn flat() -> (PosedView, GaussianDepth) {
        let view = room(1.0).0.swap_remove(0);
        let shape = view.camera.dim();
        (view, GaussianDepth::new(Array2::ones(shape), Array2::from_elem(shape, 0.01)).unwrap())
    }

    /// A few matches that agree do not tell where the other pixels are; many do.
    #[test]
    fn few_matches_leave_the_other_pixels_open() {
        let (view, prior) = flat();
        let sweep = sure(prior.dim(), 1.0, 1e-6);
        let far = |share: usize| {
            let chance = Array2::from_shape_fn(prior.dim(), |(_, x)| if x < share { 0.95 } else { 0.0 });
            let fused = fuse(&view, &prior, &sweep, &chance, 1.5).unwrap();
            fused.depth.get(30, prior.dim().1 - 1).map(|(z, v)| v.sqrt() / z).unwrap()
        };
        assert!(far(1) > 0.1, "{}", far(1));
        assert!(far(40) < 0.05, "{}", far(40));
    }

    /// Equal matches on the right give the correction on the left a small variance; where nothing is visible it has to be the prior's.
    #[test]
    fn beyond_the_other_photographs_the_prior_stays_uncertain() {
        let (view, prior) = flat();
        let shape = view.camera.dim();
        let sweep = sure(shape, 1.2, 1e-6);
        let seen = Array2::from_shape_fn(shape, |(_, x)| x >= 8);
        let chance = seen.mapv(|seen| if seen { 0.95 } else { 0.0 });
        let fused = fuse(&view, &prior, &sweep, &chance, 1.5).unwrap();
        let relative = |fused: &Fused, x: usize| fused.depth.get(30, x).map(|(z, v)| v.sqrt() / z).unwrap();
        assert!(relative(&fused, 7) < 0.08, "{}: the test has no effect", relative(&fused, 7));
        let inside = fused.depth.get(30, 60);
        let found = fused.without_unseen(&seen, &prior).unwrap();
        assert!((relative(&found, 7) - 0.1).abs() < 1e-4, "{}", relative(&found, 7));
        assert!((found.depth.mean()[(30, 7)] - found.corrected[(30, 7)]).abs() < 1e-6);
        assert_eq!(found.depth.get(30, 60), inside);
    }
}
