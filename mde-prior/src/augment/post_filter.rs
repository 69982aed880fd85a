//! The post-filter: an unsharp mask and a joint bilateral filter, limited to the detail that the crops added.

use crate::{Error, Result};
use mde_uncertainty::filter::{Border, Gaussian, JointBilateral, gaussian_blur};
use ndarray::{Array2, ArrayView2, ArrayView3, Axis, Zip};

/// Standard deviations at which Gaussians are cut off.
const CUT: f64 = 3.0;
/// Standard deviation of the blur of the image before it is compared, in pixels: sensor noise makes no edges.
const NOISE: f64 = 0.7;
/// Standard deviation of the bilateral filter in colour (0 to 1).
const COLOUR: f64 = 0.1;

/// Unsharp mask: \\(c + k (c - G_\sigma c)\\).
pub(super) fn sharpened(map: Array2<f32>, sigma: f64, gain: f64) -> Array2<f32> {
    let low = blurred(map.view(), sigma, sigma);
    Zip::from(&map).and(&low).map_collect(|&c, &low| c + gain as f32 * (c - low))
}

/// Moves `map` towards `filtered`, limited by the detail that the crops `added` nearby:
/// \\(c + \delta \min(1, \sqrt{G_{2\sigma} f^2 / G_{2\sigma} \delta^2})\\) with \\(\delta\\) the change by the filter and \\(f\\) the change by
/// the crops, less its low frequencies \\(G_\sigma\\).
pub(super) fn limit(map: &mut Array2<f32>, filtered: &Array2<f32>, added: ArrayView2<'_, f32>, sigma: f64) {
    let change = filtered - &*map;
    let low = blurred(added, sigma, sigma);
    let energy = |of: Array2<f32>| blurred(of.mapv(|v| v * v).view(), 2.0 * sigma, 2.0 * sigma);
    let (allowed, wanted) = (energy(&added - &low), energy(change.clone()));
    Zip::from(map).and(&change).and(&allowed).and(&wanted).for_each(|c, &d, &allowed, &wanted| {
        let fraction = if wanted > allowed { (allowed.max(0.0) / wanted).sqrt() } else { 1.0 };
        *c += fraction * d;
    });
}

/// Joint bilateral filter with a Gaussian of `sigma` pixels.
///
/// # Errors
/// [`crate::Error::Input`] for an image of another size.
pub(super) fn bilateral(
    map: ArrayView2<'_, f32>,
    image: ArrayView3<'_, f32>,
    sigma: f64,
) -> Result<Array2<f32>> {
    let guide: Vec<Array2<f32>> =
        image.axis_iter(Axis(2)).map(|channel| blurred(channel, NOISE, NOISE)).collect();
    let filter = JointBilateral::sparse(sigma, COLOUR);
    filter.filter(map, None, &guide).map_err(|e| Error::Input(e.to_string()))
}

/// Gaussian blur with standard deviations down the columns and along the rows, in pixels.
pub(super) fn blurred(map: ArrayView2<'_, f32>, down: f64, along: f64) -> Array2<f32> {
    gaussian_blur(map, Gaussian::new(down, CUT), Gaussian::new(along, CUT), Border::Mirror)
}
