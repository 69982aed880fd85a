//! Strategies for property tests of code that takes these types.

use crate::GaussianDepth;
use ndarray::Array2;
use proptest::prelude::*;

/// A depth map `[height, width]`: depths in 0.5 to 10, variances in 1e-6 to 1, about one pixel in eight missing.
pub fn gaussian_depth_of(height: usize, width: usize) -> impl Strategy<Value = GaussianDepth> {
    let pixel = (0.5..10.0_f32, -6.0..0.0_f32, 0..8_u8);
    proptest::collection::vec(pixel, height * width).prop_map(move |pixels| {
        let map = |f: &dyn Fn(&(f32, f32, u8)) -> f32| {
            Array2::from_shape_vec((height, width), pixels.iter().map(f).collect()).unwrap_or_default()
        };
        let variance = map(&|&(_, log_variance, dice)| {
            if dice == 0 { f32::INFINITY } else { 10_f32.powf(log_variance) }
        });
        GaussianDepth::new(map(&|p| p.0), variance).unwrap_or_else(|_| GaussianDepth::missing(height, width))
    })
}
