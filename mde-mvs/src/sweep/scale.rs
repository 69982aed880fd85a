//! The scale and gauge of depth priors: the maps from their depths to the unit of the poses.
//!
//! Matches \\( i \\) between photographs give depths \\( z_i \\) where the prior has \\( p_i \\). One factor is
//! \\( \ln z_i \approx s + \ln p_i \\); the affine gauge lets the prior's contrast be wrong too,
//!
//! \\[ \ln z_i \approx a + b\,(\ln p_i - m), \qquad b \sim N(1, \beta^2), \\]
//!
//! with \\( m \\) the mean of \\( \ln p_i \\) under the weights. Both are fitted by reweighted least squares with the weights
//! \\( 1 / (1 + (r/\sigma)^2) \\) of a Cauchy distribution. Errors of a prior are smooth over the image, so
//! neighbouring residuals are not independent: the covariance is the sandwich over patches of the image,
//! \\( H^{-1} \left( \sum_c g_c g_c^\top \right) H^{-1} \\), each patch counted once.

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use nalgebra::{Matrix2, Point3, Vector2};
use ndarray::ArrayView2;
use std::collections::BTreeMap;

use crate::statistics::robust_deviation;
use crate::{Result, nearest_pixel};

/// Patches along the longer side of an image.
const PATCHES: usize = 10;
/// Rounds of reweighting.
const ROUNDS: usize = 20;
/// Standard deviation of a prior's contrast in log depth about 1.
const CONTRAST: f64 = 0.3;
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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
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

/// The affine gauge of one photograph's prior, in log depth.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub struct Gauge {
    /// Log depth where the prior's logarithm is [`middle`](Self::middle).
    pub offset: f64,
    /// Log depth per log depth of the prior; 1 where its contrast is right.
    pub contrast: f64,
    /// \\( m \\), the mean logarithm of the prior over the matches.
    pub middle: f64,
    /// Covariance of `offset` and `contrast`, row by row.
    pub covariance: [[f64; 2]; 2],
    /// Robust standard deviation of the matches about it, in log depth.
    pub spread: f64,
}

/// Sums of a weighted line fit.
struct Fit {
    solution: Vector2<f64>,
    covariance: Matrix2<f64>,
    spread: f64,
}

/// Matches from points of the scene, such as COLMAP's, that a view is known to see: each point's depth beside the prior
/// at its pixel. Points behind the camera or off the image are left out.
///
/// # Errors
/// [`Error::View`](crate::Error::View) for a view that [`PosedView::validate`] refuses, or a prior of another size than its camera.
pub fn point_matches(
    view: &PosedView,
    points: &[Point3<f64>],
    prior: ArrayView2<'_, f32>,
) -> Result<Vec<Match>> {
    view.validate()?;
    view.camera.check_map("prior", prior.dim())?;
    let found = points.iter().filter_map(|point| {
        let there = view.pose * point;
        let at = nearest_pixel(&view.camera, &there)?;
        let patch = patch(prior.dim(), at, 0);
        let known = prior[at] > 0.0 && view.mask[at];
        known.then_some(Match { prior: prior[at], depth: there.z as f32, weight: 1.0, patch })
    });
    Ok(found.collect())
}

/// The patch of a pixel of a photograph of that height and width.
pub(super) fn patch((h, w): (usize, usize), (y, x): (usize, usize), photograph: usize) -> u32 {
    let side = (h.max(w) / PATCHES).max(1);
    ((photograph * 1024 + y / side) * 1024 + x / side) as u32
}

/// `(log prior - middle, log depth, weight, patch)`.
type Row = (f64, f64, f64, u32);

/// Reweighted least squares of `y = a + b x`; `b` is held to 1 by `contrast_precision`.
fn cauchy_line(rows: &[Row], contrast_precision: f64) -> Option<Fit> {
    let mut differences: Vec<f64> = rows.iter().map(|r| r.1 - r.0).collect();
    let mut solution = Vector2::new(quantile(&mut differences, 0.5)?, 1.0);
    let residual = |s: &Vector2<f64>, r: &Row| r.1 - s[0] - s[1] * r.0;
    let mut result = None;
    for _ in 0..ROUNDS {
        let spread = robust_deviation(rows.iter().map(|r| residual(&solution, r)))?.max(1e-4);
        let weight = |r: &Row| r.2 / (1.0 + (residual(&solution, r) / spread).powi(2));
        let mut h = Matrix2::zeros();
        let mut g = Vector2::zeros();
        for r in rows {
            let (w, x) = (weight(r), Vector2::new(1.0, r.0));
            h += w * x * x.transpose();
            g += w * r.1 * x;
        }
        // The prior of the contrast counts as one over its variance against residuals of `spread`.
        let hold = contrast_precision * spread * spread;
        h[(1, 1)] += hold;
        g[1] += hold;
        let inverse = h.try_inverse()?;
        let next = inverse * g;
        let mut patches = BTreeMap::<u32, Vector2<f64>>::new();
        for r in rows {
            let score = weight(r) * residual(&next, r) * Vector2::new(1.0, r.0);
            *patches.entry(r.3).or_insert_with(Vector2::zeros) += score;
        }
        let mut middle = Matrix2::zeros();
        patches.values().for_each(|s| middle += s * s.transpose());
        middle[(1, 1)] += hold * spread * spread;
        let done = (next - solution).amax() < 1e-9;
        solution = next;
        result = Some(Fit { solution, covariance: inverse * middle * inverse, spread });
        if done {
            break;
        }
    }
    result
}

/// Those of the matches that count, if they are enough.
fn rows(matches: &[Match]) -> Option<Vec<Row>> {
    let known = |z: f32| z > 0.0 && z.is_finite();
    let good = |m: &&Match| known(m.prior) && known(m.depth) && m.weight > 0.0;
    let row = |m: &Match| (f64::from(m.prior).ln(), f64::from(m.depth).ln(), f64::from(m.weight), m.patch);
    let rows: Vec<Row> = matches.iter().filter(good).map(row).collect();
    (rows.len() >= MIN_MATCHES).then_some(rows)
}

impl Scale {
    /// The factor that the matches agree on; nothing with fewer than 16.
    pub fn fit(matches: &[Match]) -> Option<Self> {
        let mut rows = rows(matches)?;
        // The contrast is 1, so that the ratio of the depths is an offset alone.
        for row in &mut rows {
            (row.0, row.1) = (0.0, row.1 - row.0);
        }
        let fit = cauchy_line(&rows, 1.0)?;
        let (log_scale, variance) = (fit.solution[0], fit.covariance[(0, 0)]);
        Some(Self { log_scale, variance, spread: fit.spread, matches: rows.len() })
    }
}

impl Gauge {
    /// The affine gauge that the matches agree on; nothing with fewer than 16.
    pub fn fit(matches: &[Match]) -> Option<Self> {
        let mut rows = rows(matches)?;
        let total: f64 = rows.iter().map(|r| r.2).sum();
        let middle = rows.iter().map(|r| r.2 * r.0).sum::<f64>() / total;
        for row in &mut rows {
            row.0 -= middle;
        }
        let fit = cauchy_line(&rows, CONTRAST.powi(-2))?;
        Some(Self {
            offset: fit.solution[0],
            contrast: fit.solution[1],
            middle,
            covariance: fit.covariance.transpose().into(),
            spread: fit.spread,
        })
    }

    /// One factor; the contrast is 1.
    pub fn from_scale(scale: &Scale) -> Self {
        Self {
            offset: scale.log_scale,
            contrast: 1.0,
            middle: 0.0,
            covariance: [[scale.variance, 0.0], [0.0, 0.0]],
            spread: scale.spread,
        }
    }

    /// Log depth for a depth of the prior, and the variance that the gauge's own uncertainty gives it.
    pub fn log_depth(&self, prior: f64) -> (f64, f64) {
        let x = prior.ln() - self.middle;
        let c = &self.covariance;
        let variance = c[0][0] + 2.0 * x * c[0][1] + x * x * c[1][1];
        (self.offset + self.contrast * x, variance.max(0.0))
    }

    /// A prior in the unit of the poses, with the variance of the gauge and of the matches about it.
    ///
    /// # Errors
    /// [`Error::Depth`](crate::Error::Depth) never, for depths that are positive or missing (0).
    pub fn apply(&self, prior: ArrayView2<'_, f32>) -> Result<GaussianDepth> {
        let missing = prior.mapv(|z| if z > 0.0 && z.is_finite() { 0.0 } else { f32::INFINITY });
        let gauged = GaussianDepth::new(prior.to_owned(), missing)?.map(|z, _| {
            let (log, variance) = self.log_depth(f64::from(z));
            let mean = log.exp();
            (mean as f32, (mean * mean * (variance + self.spread * self.spread)) as f32)
        });
        Ok(gauged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use nalgebra::Point2;
    use proptest::prelude::*;

    fn matches(offset: f64, contrast: f64, wrong: usize, seed: u64) -> Vec<Match> {
        (0..400_usize)
            .map(|i| {
                let bits = (i as u64).wrapping_mul(6_364_136_223_846_793_005).wrapping_add(seed) >> 40;
                let noise = bits as f64 / (1_u64 << 24) as f64 - 0.5;
                let prior = 1.0 + 0.01 * i as f64;
                let z = (offset + contrast * prior.ln() + 0.02 * noise).exp();
                let z = if i % 10 < wrong { 9.0 * z } else { z };
                Match { prior: prior as f32, depth: z as f32, weight: 1.0, patch: (i / 16) as u32 }
            })
            .collect()
    }

    proptest! {
        /// The line is found through 30 % of wrong matches.
        #[test]
        fn the_gauge_is_found(offset in -3.0..3.0_f64, contrast in 0.8..1.25_f64, wrong in 0..4_usize, seed: u64) {
            let gauge = Gauge::fit(&matches(offset, contrast, wrong, seed)).unwrap();
            for z in [1.2_f64, 2.0, 4.0] {
                let (log, _) = gauge.log_depth(z);
                prop_assert!((log - offset - contrast * z.ln()).abs() < 0.03, "{gauge:?}");
            }
        }

        /// A common factor of all depths is a shift of the offset, and of nothing else.
        #[test]
        fn the_gauge_is_equivariant(factor in 0.01..100.0_f32, seed: u64) {
            let plain = matches(0.3, 1.1, 1, seed);
            let scaled: Vec<Match> = plain.iter().map(|m| Match { depth: factor * m.depth, ..*m }).collect();
            let (a, b) = (Gauge::fit(&plain).unwrap(), Gauge::fit(&scaled).unwrap());
            prop_assert!((b.offset - a.offset - f64::from(factor).ln()).abs() < 1e-3);
            prop_assert!((b.contrast - a.contrast).abs() < 1e-3);
            let (a, b) = (Scale::fit(&plain).unwrap(), Scale::fit(&scaled).unwrap());
            prop_assert!((b.log_scale - a.log_scale - f64::from(factor).ln()).abs() < 1e-3);
        }
    }

    /// The contrast of a scale is 1, however many matches would fit another, and whatever they weigh.
    #[test]
    fn a_common_factor_of_the_weights_does_not_change_the_scale() {
        let plain = matches(0.3, 1.1, 1, 5);
        let heavy: Vec<Match> = plain.iter().map(|m| Match { weight: 1e12, ..*m }).collect();
        let (a, b) = (Scale::fit(&plain).unwrap(), Scale::fit(&heavy).unwrap());
        assert!((a.log_scale - b.log_scale).abs() < 1e-9, "{a:?} {b:?}");
        assert!((a.variance / b.variance - 1.0).abs() < 1e-9, "{a:?} {b:?}");
    }

    #[test]
    fn points_give_the_scale_of_a_prior() {
        let plane = [Plane::slanted(2.0, 0.4, -0.2)];
        let (views, depths) = scene(&plane, (48, 64), &[[0.0; 3], [0.3, 0.1, 0.2]]);
        let (view, depth) = (&views[1], &depths[1]);
        let back = view.pose.inverse();
        let pixels = (0..48).step_by(6).flat_map(|y| (0..64).step_by(6).map(move |x| (y, x)));
        let point =
            |at: (usize, usize)| view.camera.unproject(Point2::new(at.1, at.0).cast(), depth[at].into());
        let mut points: Vec<Point3<f64>> = pixels.map(|at| back * point(at)).collect();
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
        assert_eq!(Gauge::fit(&matches(0.0, 1.0, 0, 1)[..15]), None);
        let once = matches(0.0, 1.0, 0, 1);
        let thrice: Vec<Match> = once.iter().flat_map(|m| [*m; 3]).collect();
        let (a, b) = (Gauge::fit(&once).unwrap(), Gauge::fit(&thrice).unwrap());
        assert!((a.covariance[0][0] / b.covariance[0][0] - 1.0).abs() < 0.05, "{a:?} {b:?}");
    }
}
