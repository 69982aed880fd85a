//! Scale from known depths: Eq. 10-13 with the known depths in the place of the prior, by a [`RobustLine`].
//!
//! With \\(u\\) the refined depth at the known pixels and \\(v\\) the known depths, \\(v \approx a u + b\\). For a map from disparities of
//! unknown scale and shift both are disparities, \\(u = 1/D\\): there the affine map is exact, \\(1/z = a d + b\\). A shift below twice its
//! own standard deviation is left out for depths. The variance of \\(a u + b\\) becomes a part of sigma.

use crate::error::{Error, Result};
use crate::reports::{Component, Refinement};
use crate::scene::known::{KnownDepth, check};
use mde_fusion::{Affine, LinePoint, RobustLine};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use ndarray::{ArrayView2, Zip};
use serde::Serialize;

/// The map from a refinement to the known depths.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScaleReport {
    /// Whether the map is one of disparities, \\(1/z = a/D + b\\), and not of depths, \\(z = a D + b\\).
    pub of_disparity: bool,
    /// \\(a\\).
    pub a: f64,
    /// \\(b\\), in the unit of the known depths, or its inverse.
    pub b: f64,
    /// Known depths at a pixel with a depth.
    pub points: usize,
    /// Those that weigh less than half, as they do not fit.
    pub outliers: usize,
    /// Median of \\(|D'/v - 1|\\) after the map.
    pub median_error: Option<f64>,
    /// Median standard deviation of the map, as a fraction of the depth.
    pub sigma: Option<f64>,
}

/// Components of sigma: the errors of the map to known depths, and of the factor to a scale in common.
const SCALE: &str = "scale";
const SAME_SCALE: &str = "same-scale";

impl Refinement {
    /// The refinement in the unit of known depths: depth, prior, sigma and its components, with the error of the map as a component
    /// `scale`. With `of_disparity`, for a prior that gave disparities, scale and shift are those of the disparity.
    ///
    /// # Errors
    /// [`Error::Argument`] for a known depth that is not positive and finite, too few of them at a pixel with a depth (1, and 2 for
    /// disparities), or a map that turns near into far.
    pub fn scaled_to(self, known: &[KnownDepth], of_disparity: bool) -> Result<(Self, ScaleReport)> {
        // A depth or its disparity, and what divides the variance of the one to give that of the other.
        let unit = |z: f64| if of_disparity { 1.0 / z } else { z };
        let divisor = |z: f64| if of_disparity { z.powi(4) } else { 1.0 };
        known.iter().try_for_each(check)?;
        let point = |&KnownDepth { x, y, depth: v, sigma }: &KnownDepth| {
            let (x, y) = (x.round(), y.round());
            let (z, variance) = self.depth.get(y as usize, x as usize).filter(|_| x >= 0.0 && y >= 0.0)?;
            let (z, variance) = (f64::from(z), f64::from(variance));
            let (u_variance, v_variance) = (variance / divisor(z), sigma.powi(2) / divisor(v));
            (z > 0.0).then(|| LinePoint { u: unit(z), u_variance, v: unit(v), v_variance })
        };
        let points: Vec<LinePoint> = known.iter().filter_map(point).collect();
        let least = if of_disparity { 2 } else { 1 };
        if points.len() < least {
            return Err(Error::Argument(format!(
                "{} of {} known depths lie at a pixel with a depth; give {least} or more (columns: x, y, depth, from the upper left)",
                points.len(),
                known.len()
            )));
        }
        let line = RobustLine::fit(&points, of_disparity).ok_or_else(|| {
            Error::Argument("the known depths do not fit: nearer ones are farther in the map; check their pixels and units".to_owned())
        })?;
        let Affine { a, b } = line.affine;
        // Depth, its derivative, and the map's variance.
        let of_value = |u: f64| {
            let v = a * u + b;
            let depth = unit(v);
            let slope = if of_disparity { a * (u / v).powi(2) } else { a };
            let usable = v > 0.0 && depth.is_finite() && (depth as f32) > 0.0;
            usable.then(|| (depth, slope, line.variance(u) / divisor(v)))
        };
        let error =
            |point: &LinePoint| of_value(point.u).map(|(depth, ..)| (depth / unit(point.v) - 1.0).abs());
        let median_error = median(points.iter().filter_map(error));
        let (refined, sigma) = self.mapped(Some(SCALE), |z| of_value(unit(z)))?;
        let factor = if of_disparity { a.recip() } else { a };
        let refined = refined.with_poses((b == 0.0).then_some(factor));
        let (points, outliers) = (points.len(), line.outliers);
        Ok((refined, ScaleReport { of_disparity, a, b, points, outliers, median_error, sigma }))
    }

    /// The refinement times a factor whose logarithm has the standard deviation `log_sigma`: depth, prior, sigma and its components.
    /// The factor's error, `log_sigma` times the depth, becomes a part of sigma and of the component `same-scale`.
    ///
    /// # Errors
    /// [`Error::Argument`] for a factor that is not positive and finite, or a deviation that is negative or not finite.
    pub fn scaled(self, factor: f64, log_sigma: f64) -> Result<Self> {
        let usable = factor > 0.0 && factor.is_finite() && log_sigma >= 0.0 && log_sigma.is_finite();
        if !usable {
            return Err(Error::Argument(format!(
                "the factor {factor} +- {log_sigma} (of its logarithm) is no positive number; give one with the deviation of its logarithm"
            )));
        }
        let mapped = |z: f64| {
            let depth = factor * z;
            let usable = depth.is_finite() && (depth as f32) > 0.0;
            usable.then_some((depth, factor, (log_sigma * depth).powi(2)))
        };
        Ok(self.mapped(Some(SAME_SCALE), mapped)?.0.with_poses(Some(factor)))
    }

    /// The photographs' poses in the unit of the depth, which was multiplied by `factor`. None where it was bent: no poses fit it then.
    pub(crate) fn with_poses(mut self, factor: Option<f64>) -> Self {
        for photograph in self.capture.iter_mut().flat_map(|capture| &mut capture.photographs) {
            photograph.pose = photograph.pose.zip(factor).map(|(mut pose, factor)| {
                pose.translation.vector *= factor;
                pose
            });
        }
        self
    }

    /// Each depth by a map that gives the new one, the map's derivative, and its variance, which becomes a part of sigma and of the
    /// component of that name, where it has one; and that part's median, as a fraction of the depth.
    pub(crate) fn mapped(
        self,
        name: Option<&'static str>,
        mapped: impl Fn(f64) -> Option<(f64, f64, f64)>,
    ) -> Result<(Self, Option<f64>)> {
        let at = |z: f32| (z > 0.0).then(|| mapped(f64::from(z))).flatten();
        let new = |z: f32| at(z).map_or(0.0, |(depth, ..)| depth as f32);
        let old = self.depth.mean();
        let scale = old.mapv(|z| at(z).map_or(f32::INFINITY, |(.., variance)| variance.sqrt() as f32));
        let slopes = old.mapv(|z| at(z).map_or(0.0, |(_, slope, _)| slope as f32));
        let depth = old.mapv(new);
        let of_known = |map: ArrayView2<'_, f32>, value: fn(f32, f32, f32) -> f32| {
            Zip::from(map).and(&slopes).and(&scale).map_collect(|&map, &slope, &scale| {
                if scale.is_finite() { value(map, slope, scale) } else { f32::INFINITY }
            })
        };
        let variance = of_known(self.depth.variance(), |v, slope, scale| {
            (slope * slope * v + scale * scale).max(f32::MIN_POSITIVE)
        });
        let mut components = self.components;
        for part in &mut components {
            part.sigma = of_known(part.sigma.view(), |sigma, slope, _| slope * sigma);
        }
        let sigma =
            median(scale.iter().zip(&depth).filter(|(_, z)| **z > 0.0).map(|(s, z)| f64::from(s / z)));
        if let Some(part) = components.iter_mut().find(|part| Some(part.name) == name) {
            part.sigma.zip_mut_with(&scale, |all, own| *all = all.hypot(*own));
        } else if let Some(name) = name {
            components.push(Component { name, sigma: scale });
        }
        let depth = GaussianDepth::new(depth, variance)?;
        Ok((Self { depth, components, prior: self.prior.mapv(new), ..self }, sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use proptest::prelude::*;

    fn refinement(depth: &Array2<f32>, relative: f32) -> Refinement {
        let variance = depth.mapv(|z| (relative * z).powi(2));
        let depth = GaussianDepth::new(depth.clone(), variance).unwrap();
        let sigma = depth.sigma();
        let components = vec![Component { name: "spread", sigma }];
        Refinement {
            prior: depth.mean().to_owned(),
            depth,
            components,
            ..Refinement::of_prior(Array2::zeros((0, 0)))
        }
    }

    fn scene(seed: u64) -> Array2<f32> {
        Array2::from_shape_fn((24, 32), |(y, x)| {
            1.0 + 0.1 * x as f32 + 0.05 * y as f32 + 0.3 * ((seed as f32 + x as f32) * 0.7).sin()
        })
    }

    fn points(truth: &Array2<f32>, every: usize) -> Vec<KnownDepth> {
        let chosen = truth.indexed_iter().step_by(every);
        chosen
            .map(|((y, x), &z)| KnownDepth { x: x as f64, y: y as f64, depth: f64::from(z), sigma: 0.0 })
            .collect()
    }

    /// Known depths that are an exact map of the result, as depths or as disparities, bring it to them.
    #[test]
    fn an_exact_map_is_found() {
        let depth = scene(3);
        for (of_disparity, map) in
            [(true, (|z| 1.0 / (0.7 / z + 0.2)) as fn(f32) -> f32), (false, |z| 0.7 * z + 0.2)]
        {
            let truth = depth.mapv(map);
            let known = points(&truth, 7);
            let (scaled, report) = refinement(&depth, 0.05).scaled_to(&known, of_disparity).unwrap();
            let off = (&scaled.depth.mean() / &truth - 1.0).mapv_into(f32::abs);
            assert!(off.iter().all(|off| *off < 1e-3), "{report:?}");
            assert_eq!((scaled.components.last().unwrap().name, report.points), ("scale", known.len()));
        }
    }

    proptest! {
        /// Depth, prior, sigma and components times the factor; its error adds to sigma, and to the component that is there.
        #[test]
        fn a_factor_scales_everything(factor in 0.1..10.0_f64, log_sigma in 0.0..0.3_f64, seed in 0..20_u64) {
            let mut depth = scene(seed);
            depth[(3, 4)] = 0.0;
            let before = refinement(&depth, 0.05);
            let (old, old_sigma) = (before.depth.mean().to_owned(), before.depth.sigma());
            let once = before.scaled(factor, log_sigma).unwrap();
            let near = |a: f32, b: f64| (f64::from(a) - b).abs() <= 1e-5 * b.abs();
            for (at, z) in old.indexed_iter().map(|(at, z)| (at, f64::from(*z))) {
                let sigma = once.depth.sigma()[at];
                if z == 0.0 {
                    prop_assert!(once.depth.mean()[at] == 0.0 && sigma.is_infinite());
                    continue;
                }
                prop_assert!(near(once.depth.mean()[at], factor * z) && near(once.prior[at], factor * z));
                prop_assert!(near(once.components[0].sigma[at], factor * f64::from(old_sigma[at])));
                prop_assert!(near(once.components[1].sigma[at], log_sigma * factor * z));
                prop_assert!(near(sigma, (factor * f64::from(old_sigma[at])).hypot(log_sigma * factor * z)));
            }
            let twice = once.scaled(1.0 / factor, log_sigma).unwrap();
            prop_assert_eq!(twice.components.iter().map(|part| part.name).collect::<Vec<_>>(), ["spread", "same-scale"]);
            let expected = 2.0_f64.sqrt() * log_sigma * f64::from(old[(9, 9)]);
            prop_assert!(near(twice.components[1].sigma[(9, 9)], expected));
        }
    }

    #[test]
    fn one_point_scales_and_faults_are_named() {
        let depth = scene(0);
        let one = [KnownDepth { x: 4.0, y: 5.0, depth: 2.0 * f64::from(depth[(5, 4)]), sigma: 0.1 }];
        let (scaled, report) = refinement(&depth, 0.0).scaled_to(&one, false).unwrap();
        assert!((report.a - 2.0).abs() < 1e-6 && report.b == 0.0, "{report:?}");
        // The point's own error is the scale's.
        let share = 0.1 / (2.0 * depth[(5, 4)]);
        let found = scaled.components.last().unwrap().sigma[(20, 30)] / scaled.depth.mean()[(20, 30)];
        assert!((found / share - 1.0).abs() < 1e-3, "{found} {share}");
        let error = |known: &[KnownDepth], of_disparity| {
            refinement(&depth, 0.05).scaled_to(known, of_disparity).err().unwrap().to_string()
        };
        assert!(error(&[KnownDepth { depth: -1.0, ..one[0] }], false).contains("no positive number"));
        for (factor, log_sigma) in
            [(0.0, 0.1), (f64::NAN, 0.1), (f64::INFINITY, 0.1), (2.0, -0.1), (2.0, f64::NAN)]
        {
            let refused = refinement(&depth, 0.05).scaled(factor, log_sigma).err().unwrap().to_string();
            assert!(refused.contains("no positive number"), "{refused}");
        }
        let turned = points(&depth.mapv(|z| 1.0 / z), 5);
        assert!(error(&turned, true).contains("do not fit"));
        assert!(refinement(&depth, 0.0).scaled_to(&points(&depth, 9), true).is_ok());
    }
}
