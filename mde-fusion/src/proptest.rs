//! Strategies for property tests of code that fuses.

use crate::{
    Aggregation, Calibration, Fusion, FusionConfig, Gaussian, Prior, PriorVariance, Residual, Sample,
    VarianceRule,
};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::proptest::gaussian_depth_of;
use ndarray::Array2;
use proptest::collection::vec;
use proptest::prelude::*;

/// A prior and up to `max_views` views of it, at most `max_side` pixels per side: depths in 0.5 to 10, variances in
/// 1e-6 to 1, some pixels missing in each.
pub fn scene(max_side: usize, max_views: usize) -> impl Strategy<Value = (Prior, Vec<GaussianDepth>)> {
    (1..=max_side, 1..=max_side).prop_flat_map(move |(height, width)| {
        (prior_of(height, width), vec(gaussian_depth_of(height, width), 0..=max_views))
    })
}

/// A prior `[height, width]` with depths in 0.5 to 10, about one pixel in eight missing.
pub fn prior_of(height: usize, width: usize) -> impl Strategy<Value = Prior> {
    gaussian_depth_of(height, width).prop_map(|map| prior(map.into_parts().0))
}

/// As [`scene`], with extreme inputs: constant and empty maps, variance 0, subnormal and huge values, negative views, priors with
/// a variance.
pub fn wild_scene(max_side: usize, max_views: usize) -> impl Strategy<Value = (Prior, Vec<GaussianDepth>)> {
    let value = prop_oneof![
        4 => 0.5..10.0_f32,
        1 => prop::sample::select(vec![1e-45, f32::MIN_POSITIVE, 1e-20, 1.0, 1.0, 1e20, f32::MAX]),
    ];
    let variance =
        prop_oneof![4 => 1e-6..1.0_f32, 1 => Just(0.0), 1 => Just(f32::INFINITY), 1 => value.clone()];
    (1..=max_side, 1..=max_side, 0..3_u8).prop_flat_map(move |(height, width, kind)| {
        let pixels = height * width;
        // Kind 0: one value everywhere. Kind 1: all missing. Kind 2: per pixel.
        let map = move |(mean, variance): (Vec<f32>, Vec<f32>), sign: f32| {
            let pick =
                |values: &[f32], i: usize| values.get(if kind == 0 { 0 } else { i }).copied().unwrap_or(1.0);
            let mean = Array2::from_shape_fn((height, width), |(r, c)| sign * pick(&mean, r * width + c));
            let variance = Array2::from_shape_fn((height, width), |(r, c)| match kind {
                1 => f32::INFINITY,
                _ => pick(&variance, r * width + c),
            });
            GaussianDepth::new(mean, variance).unwrap_or_else(|_| GaussianDepth::missing(height, width))
        };
        let planes = (vec(value.clone(), pixels), vec(variance.clone(), pixels));
        let sign = prop::sample::select(vec![1.0_f32, 1.0, 1.0, -1.0]);
        let views =
            vec((planes.clone(), sign).prop_map(move |(planes, sign)| map(planes, sign)), 0..=max_views);
        let prior = (planes, any::<bool>()).prop_map(move |(planes, with_variance)| {
            let depth = map(planes, 1.0);
            match Prior::with_variance(depth.clone()) {
                Ok(prior) if with_variance => prior,
                _ => prior(depth.into_parts().0),
            }
        });
        (prior, views)
    })
}

/// `size` samples of the affine fit: depths in 0.5 to 10, variances in 1e-6 to 1, the first two far apart.
pub fn samples(size: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Sample>> {
    let sample = (0.5..10.0_f64, -6.0..0.0_f64, 0.5..10.0_f64).prop_map(|(u, log_variance, v)| Sample {
        u,
        variance: 10_f64.powf(log_variance),
        v,
    });
    vec(sample, size).prop_map(|mut samples| {
        for (sample, u) in samples.iter_mut().zip([0.5, 10.0]) {
            (sample.u, sample.variance) = (u, 0.1);
        }
        samples
    })
}

/// Residuals in -1 to 1 with variances in 1e-6 to 1.
pub fn residuals(size: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Residual>> {
    let residual = (-1.0..1.0_f64, -6.0..0.0_f64)
        .prop_map(|(delta, log_variance)| Residual { delta, variance: 10_f64.powf(log_variance) });
    vec(residual, size)
}

/// A Gaussian with a mean in 0.5 to 10 and a variance in 1e-6 to 1.
pub fn gaussian() -> impl Strategy<Value = Gaussian> {
    (0.5..10.0_f64, -6.0..0.0_f64)
        .prop_map(|(mean, log_variance)| Gaussian::new(mean, 10_f64.powf(log_variance)))
}

/// Any combination of the choices in a [`FusionConfig`].
pub fn config() -> impl Strategy<Value = FusionConfig> {
    let choices = (0..2_usize, 0..3_usize, 0..2_usize, 0..3_usize, 0..2_usize);
    (choices, any::<bool>()).prop_map(|((v, a, c, p, f), clamped)| {
        let floor = if clamped { 1e-3 } else { 0.0 };
        FusionConfig {
            variance: [VarianceRule::Computed, VarianceRule::ConstantMedian][v],
            variance_floor: floor,
            aggregation: [Aggregation::Precision, Aggregation::Mixture, Aggregation::MinDepth][a],
            calibration: [Calibration::Wls, Calibration::None][c],
            prior_variance: [
                PriorVariance::Moments,
                PriorVariance::FixedMedian,
                PriorVariance::FixedRelative,
            ][p],
            fusion: [Fusion::Bayes, Fusion::NerfOnly][f],
            common_error: floor,
            ..FusionConfig::paper()
        }
    })
}

fn prior(mean: Array2<f32>) -> Prior {
    let (height, width) = mean.dim();
    Prior::new(mean).unwrap_or_else(|_| Prior::missing(height, width))
}
