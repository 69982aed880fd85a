//! What the PNG files of a result hold: the scale of a depth, and the confidence.

use super::MILLIMETRES;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::pooled::Tails;
use mde_uncertainty::statistics::median;
use ndarray::{Array2, Zip};
use serde::Serialize;

/// The unit of metric depth.
const METRES: &str = "m";
/// Least steps of the median depth in an unknown unit.
const FEWEST_STEPS: f64 = 100.0;
/// Error whose probability the confidence states, as a share of the depth.
const WITHIN: f64 = 0.1;
/// How [`confidence`] follows from depth and sigma.
pub fn confidence_formula(tails: Tails) -> &'static str {
    match tails {
        Tails::Normal => {
            "erf(0.1 depth / (sqrt(2) sigma)), the probability of an error below 10 % of the depth"
        }
        Tails::Heavy => {
            "0.1 depth / sqrt((0.1 depth)^2 + (0.7966 sigma)^2), the probability of an error below 10 % of the depth"
        }
    }
}

/// Unit and scale of a PNG of depths.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct DepthPng {
    /// Name of the unit.
    #[serde(skip)]
    pub unit: &'static str,
    /// Value = depth times this.
    #[serde(rename = "png_scale")]
    pub scale: f64,
    /// Number of pixels whose depth does not fit, and that are missing in the file.
    #[serde(rename = "png_missing_pixels")]
    pub beyond: usize,
}

impl DepthPng {
    /// Millimetres for metres. In any other unit thousandths too, unless the depths do not fit or are too coarse; then the scale that fits.
    pub fn new(unit: &'static str, depths: impl Iterator<Item = f32> + Clone) -> Self {
        let known = depths.filter(|depth| *depth > 0.0 && depth.is_finite());
        let too_far = |depth: &f32| (f64::from(*depth) * MILLIMETRES).round() > f64::from(u16::MAX);
        let beyond = known.clone().filter(too_far).count();
        if unit == METRES {
            return Self { unit, scale: MILLIMETRES, beyond };
        }
        let coarse = median(known.clone().map(f64::from)).is_some_and(|z| z * MILLIMETRES < FEWEST_STEPS);
        let scale = if coarse || beyond > 0 { fitting(known) } else { MILLIMETRES };
        Self { unit, scale, beyond: 0 }
    }

    /// A warning where depths do not fit.
    pub fn warning(&self) -> Option<String> {
        let Self { beyond, .. } = self;
        (*beyond > 0).then(|| {
            format!(
                "{beyond} pixels are farther than the 65.535 m that depth.png can hold, and are missing there (0); use depth.npy for them"
            )
        })
    }
}

/// The probability of an error below a tenth of the depth; 0 where depth is missing.
pub fn confidence(depth: &GaussianDepth, tails: Tails) -> Array2<f32> {
    Zip::from(depth.mean()).and(depth.variance()).map_collect(|&depth, &variance| {
        if depth <= 0.0 || variance.is_infinite() {
            return 0.0;
        }
        let sigmas = WITHIN * f64::from(depth) / f64::from(variance).sqrt();
        if sigmas.is_finite() { tails.within(sigmas) as f32 } else { 1.0 }
    })
}

/// The largest of 1, 2, 5, 10, ... steps per unit (and their tenths) at which the largest depth fits into 16 bits.
fn fitting(depths: impl Iterator<Item = f32>) -> f64 {
    let largest = f64::from(depths.fold(0.0, f32::max));
    if !(largest > 0.0 && largest.is_finite()) {
        return MILLIMETRES;
    }
    let most = f64::from(u16::MAX) / largest;
    let power = 10_f64.powf(most.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|step| step * power).find(|scale| *scale <= most).unwrap_or(0.5 * power)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn metres_are_always_millimetres() {
        let png = |depths: &[f32]| DepthPng::new("m", depths.iter().copied());
        assert_eq!((png(&[0.01]).scale, png(&[]).scale), (1000.0, 1000.0));
        let far = png(&[2.0, 65.535, 65.536, f32::INFINITY, 900.0]);
        assert_eq!((far.scale, far.beyond), (1000.0, 2));
        assert!(far.warning().unwrap().starts_with("2 pixels") && png(&[3.0]).warning().is_none());
    }

    #[test]
    fn another_unit_has_thousandths_where_they_fit() {
        let scale = |depths: &[f32]| DepthPng::new("unscaled", depths.iter().copied()).scale;
        assert_eq!(scale(&[0.8, 8.0]), 1000.0);
        assert_eq!(scale(&[3.0, 6500.0]), 10.0);
        assert_eq!(scale(&[1e-4, 3e-4]), 2e8);
        assert_eq!(scale(&[]), 1000.0);
        for largest in [1e-20_f32, 0.001, 0.65535, 7.0, 65535.0, 1e9, 1e30] {
            let steps = f64::from(largest) * fitting([largest].into_iter());
            assert!((13_000.0..=65_535.5).contains(&steps), "{largest}: {steps}");
        }
    }

    #[test]
    fn the_confidence_is_the_probability_of_a_small_error() {
        let depth = array![[2.0, 2.0, 2.0, 0.0]];
        // sigma: 10 % of the depth, none, far too large, missing.
        let variance = array![[0.04, 0.0, 1e12, f32::INFINITY]];
        let depth = GaussianDepth::new(depth, variance).unwrap();
        for (tails, at_one_sigma) in [(Tails::Normal, 0.682_689_5), (Tails::Heavy, 0.782_149_5)] {
            let confidence = confidence(&depth, tails);
            assert!((confidence[(0, 0)] - at_one_sigma).abs() < 1e-6, "{confidence}");
            assert_eq!(confidence[(0, 1)], 1.0);
            assert!(confidence[(0, 2)] < 1e-6 && confidence[(0, 3)] == 0.0, "{confidence}");
        }
    }
}
