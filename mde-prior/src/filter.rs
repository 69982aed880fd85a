//! Filters of maps.

use ndarray::{Array2, ArrayView2, Axis};

/// Gaussian blur of a map `[height, width]` with standard deviations down and across, in pixels. The kernel is cut at three
/// standard deviations; borders are mirrored.
#[must_use]
pub fn gaussian_blur(map: ArrayView2<'_, f32>, (down, across): (f64, f64)) -> Array2<f32> {
    let mut out = map.to_owned();
    for (axis, sigma) in [(Axis(0), down), (Axis(1), across)] {
        let kernel = kernel(sigma);
        if kernel.len() == 1 {
            continue;
        }
        let source = out.clone();
        let length = source.len_of(axis);
        let reach = kernel.len() / 2;
        for i in 0..length {
            let mut line = out.index_axis_mut(axis, i);
            line.fill(0.0);
            for (k, &weight) in kernel.iter().enumerate() {
                let from =
                    source.index_axis(axis, mirrored(i as isize + k as isize - reach as isize, length));
                line.zip_mut_with(&from, |sum, &v| *sum += weight * v);
            }
        }
    }
    out
}

/// Normalised, cut at three standard deviations; a single 1 for a standard deviation of 0.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = if sigma > 0.0 { (3.0 * sigma).ceil() as i64 } else { 0 };
    let weights: Vec<f64> =
        (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma.max(1e-9)).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / total) as f32).collect()
}

/// The index inside of a mirrored border.
fn mirrored(i: isize, length: usize) -> usize {
    let period = 2 * length as isize;
    let i = i.rem_euclid(period);
    (if i < length as isize { i } else { period - 1 - i }) as usize
}
