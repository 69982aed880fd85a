//! The scale of depth priors: one factor from their depths to the unit of the poses.
//!
//! Matches \\( i \\) between photographs give depths \\( z_i \\) where the prior has \\( p_i \\), with
//!
//! \\[ \ln z_i \approx s + \ln p_i . \\]
//!
//! \\( s \\) is fitted by reweighted least squares with the weights \\( 1 / (1 + (r/\sigma)^2) \\) of a Cauchy distribution. Errors of a
//! prior are smooth over the image, so neighbouring residuals are not independent: the variance is the sandwich over patches of
//! the image, \\( \sum_c g_c^2 / h^2 \\) with \\( g_c = \sum_{i \in c} w_i r_i \\) and \\( h = \sum_i w_i \\), each patch counted once.

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::PosedView;
use nalgebra::Point3;
use ndarray::{Array2, ArrayView2};
use std::collections::BTreeMap;

use crate::statistics::robust_deviation;
use crate::{Result, check_map};

/// Patches along the longer side of an image.
pub(crate) const PATCHES: usize = 10;
/// Rounds of reweighting.
const ROUNDS: usize = 20;
/// Least number of matches for a fit.
const MIN_MATCHES: usize = 16;

/// A depth in the unit of the poses where the prior has another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// The prior's depth, positive.
    pub prior: f32,
    /// The depth by matches or sparse points, positive.
    pub depth: f32,
    /// Weight, 0 or more.
    pub weight: f32,
    /// The patch of the image that it lies in; errors within a patch are treated as one error.
    pub patch: u32,
}

/// One factor from the prior's depths to the unit of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub struct Scale {
    /// Its logarithm.
    pub log_scale: f64,
    /// Variance of the logarithm.
    pub variance: f64,
    /// Robust standard deviation of the matches about it, in log depth.
    pub spread: f64,
    /// Number of matches.
    pub matches: usize,
}

/// Matches from points of the scene, such as COLMAP's, that a view is known to see: each point's depth beside the prior
/// at its pixel. Points behind the camera or off the image are left out.
///
/// # Errors
/// [`Error::View`] for a view that [`PosedView::validate`] refuses, or a prior of another size than its camera.
pub fn point_matches(
    view: &PosedView,
    points: &[Point3<f64>],
    prior: ArrayView2<'_, f32>,
) -> Result<Vec<Match>> {
    view.validate()?;
    check_map("prior", prior.dim(), &view.camera)?;
    let (h, w) = view.camera.dim();
    let found = points.iter().filter_map(|point| {
        let there = view.pose * point;
        let pixel = view.camera.project(&there)?;
        let (x, y) = (pixel.x.round(), pixel.y.round());
        if !(x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64) {
            return None;
        }
        let at = (y as usize, x as usize);
        let side = (h.max(w) / PATCHES).max(1);
        let patch = (at.0 / side * 1024 + at.1 / side) as u32;
        let known = prior[at] > 0.0 && view.mask[at];
        known.then_some(Match { prior: prior[at], depth: there.z as f32, weight: 1.0, patch })
    });
    Ok(found.collect())
}

/// `(log depth - log prior, weight, patch)`.
type Row = (f64, f64, u32);

fn rows(matches: &[Match]) -> Vec<Row> {
    let good = |m: &&Match| {
        m.prior > 0.0 && m.depth > 0.0 && m.weight > 0.0 && m.prior.is_finite() && m.depth.is_finite()
    };
    let row = |m: &Match| (f64::from(m.depth).ln() - f64::from(m.prior).ln(), f64::from(m.weight), m.patch);
    matches.iter().filter(good).map(row).collect()
}

impl Scale {
    /// The factor that the matches agree on; nothing with fewer than 16.
    pub fn fit(matches: &[Match]) -> Option<Self> {
        let rows = rows(matches);
        if rows.len() < MIN_MATCHES {
            return None;
        }
        let mut log_scale = median(rows.iter().map(|row| row.0))?;
        let (mut variance, mut spread) = (0.0, 0.0);
        for _ in 0..ROUNDS {
            spread = robust_deviation(rows.iter().map(|row| row.0 - log_scale))?.max(1e-4);
            let weight = |row: &Row| row.1 / (1.0 + ((row.0 - log_scale) / spread).powi(2));
            let total: f64 = rows.iter().map(weight).sum();
            let next = rows.iter().map(|row| weight(row) * row.0).sum::<f64>() / total;
            let mut patches = BTreeMap::<u32, f64>::new();
            rows.iter().for_each(|row| *patches.entry(row.2).or_default() += weight(row) * (row.0 - next));
            variance = patches.values().map(|score| score * score).sum::<f64>() / (total * total);
            let done = (next - log_scale).abs() < 1e-9;
            log_scale = next;
            if done {
                break;
            }
        }
        Some(Self { log_scale, variance, spread, matches: rows.len() })
    }

    /// A prior in the unit of the poses, with the variance of the scale and of the matches about it; 0 with infinite variance
    /// where the prior has no depth.
    ///
    /// # Errors
    /// None, for depths that are positive or missing (0).
    pub fn apply(&self, prior: ArrayView2<'_, f32>) -> Result<GaussianDepth> {
        let (factor, relative) = (self.log_scale.exp(), self.variance + self.spread * self.spread);
        let known = |z: f32| z > 0.0 && z.is_finite();
        let mean: Array2<f32> = prior.mapv(|z| if known(z) { (factor * f64::from(z)) as f32 } else { 0.0 });
        let variance = prior.mapv(|z| match known(z) {
            true => ((factor * f64::from(z)).powi(2) * relative) as f32,
            false => f32::INFINITY,
        });
        Ok(GaussianDepth::new(mean, variance)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use proptest::prelude::*;

    fn matches(offset: f64, wrong: usize, seed: u64) -> Vec<Match> {
        (0..400_usize)
            .map(|i| {
                let noise = ((i as u64).wrapping_mul(6_364_136_223_846_793_005).wrapping_add(seed) >> 40)
                    as f64
                    / (1_u64 << 24) as f64
                    - 0.5;
                let prior = 1.0 + 0.01 * i as f64;
                let z = prior * (offset + 0.02 * noise).exp();
                let z = if i % 10 < wrong { 9.0 * z } else { z };
                Match { prior: prior as f32, depth: z as f32, weight: 1.0, patch: (i / 16) as u32 }
            })
            .collect()
    }

    proptest! {
        /// The factor is found through 30 % of wrong matches, and follows the unit of the depths.
        #[test]
        fn the_scale_is_found(offset in -3.0..3.0_f64, wrong in 0..4_usize, factor in 0.01..100.0_f32, seed: u64) {
            let plain = matches(offset, wrong, seed);
            let scaled: Vec<Match> = plain.iter().map(|m| Match { depth: factor * m.depth, ..*m }).collect();
            let (a, b) = (Scale::fit(&plain).unwrap(), Scale::fit(&scaled).unwrap());
            prop_assert!((a.log_scale - offset).abs() < 0.03, "{a:?}");
            prop_assert!((b.log_scale - a.log_scale - f64::from(factor).ln()).abs() < 1e-3);
        }
    }

    #[test]
    fn points_give_the_scale_of_a_prior() {
        let plane = [Plane::slanted(2.0, 0.4, -0.2)];
        let (views, depths) = scene(&plane, (48, 64), &[[0.0; 3], [0.3, 0.1, 0.2]]);
        let (view, depth) = (&views[1], &depths[1]);
        let back = view.pose.inverse();
        let mut points: Vec<Point3<f64>> = (0..48)
            .step_by(6)
            .flat_map(|y| (0..64).step_by(6).map(move |x| (y, x)))
            .map(|p| back * view.camera.unproject([p.1 as f64, p.0 as f64].into(), depth[p].into()))
            .collect();
        let seen = points.len();
        points.push(back * Point3::new(0.0, 0.0, -1.0));
        points.push(back * Point3::new(50.0, 0.0, 1.0));
        let matches = point_matches(view, &points, depth.mapv(|z| 3.0 * z).view()).unwrap();
        assert_eq!(matches.len(), seen);
        let scale = Scale::fit(&matches).unwrap();
        assert!((scale.log_scale + 3_f64.ln()).abs() < 1e-4, "{scale:?}");
    }

    #[test]
    fn few_matches_give_nothing_and_patches_count_once() {
        assert_eq!(Scale::fit(&matches(0.0, 0, 1)[..15]), None);
        let once = matches(0.0, 0, 1);
        let thrice: Vec<Match> = once.iter().flat_map(|m| [*m; 3]).collect();
        let (a, b) = (Scale::fit(&once).unwrap(), Scale::fit(&thrice).unwrap());
        assert!((a.variance / b.variance - 1.0).abs() < 0.05, "{a:?} {b:?}");
    }
}
