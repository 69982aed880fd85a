use mde_uncertainty::filter::{Border, Gaussian, gaussian_blur};
use ndarray::Array2;

/// Gaussian blur with zeros outside, cut off at four sigma.
pub(crate) fn blur(map: Array2<f64>, sigma: f64) -> Array2<f64> {
    blur_within(map, sigma, (4.0 * sigma + 0.5) as usize)
}

/// [`blur`] cut off at a radius in pixels.
pub(crate) fn blur_within(map: Array2<f64>, sigma: f64, radius: usize) -> Array2<f64> {
    let gaussian = Gaussian { sigma, radius };
    gaussian_blur(map.view(), gaussian, gaussian, Border::Zero)
}
