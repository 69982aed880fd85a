//! Strategies for property tests of code that takes these types.

use crate::GaussianDepth;
use ndarray::Array2;
use proptest::collection::vec;
use proptest::prelude::*;

/// A depth map `[height, width]`: depths in 0.5 to 10, variances in 1e-6 to 1, about one pixel in eight missing.
pub fn gaussian_depth_of(height: usize, width: usize) -> impl Strategy<Value = GaussianDepth> {
    let known = (-6.0..0.0_f32).prop_map(|log_variance| 10_f32.powf(log_variance));
    let variance = prop_oneof![7 => known, 1 => Just(f32::INFINITY)];
    let pixels = height * width;
    (vec(0.5..10.0_f32, pixels), vec(variance, pixels)).prop_map(move |(mean, variance)| {
        let map = |values| Array2::from_shape_vec((height, width), values).unwrap_or_default();
        GaussianDepth::new(map(mean), map(variance)).unwrap_or_else(|_| GaussianDepth::missing(height, width))
    })
}

/// The bins of a ray, front to back: density, representative depth and extent.
pub fn ray() -> impl Strategy<Value = (Vec<f64>, Vec<f64>, Vec<f64>)> {
    vec((0.0..30.0_f64, 0.01..0.5_f64), 1..40).prop_map(|bins| {
        let (density, extent): (Vec<f64>, Vec<f64>) = bins.into_iter().unzip();
        let mut edge = 0.5;
        let middle = |extent: &f64| {
            edge += extent;
            edge - 0.5 * extent
        };
        (density, extent.iter().map(middle).collect(), extent)
    })
}
