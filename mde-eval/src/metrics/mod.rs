//! The metrics, one function each, with its equation and its source.
//!
//! Depths are z-depths in one unit (metres, where a threshold is in metres), already aligned
//! ([`align`](crate::align)). An error is *prediction minus truth*. Ties are averaged, never broken by index.

pub mod boundary;
pub mod calibration;
pub mod cloud;
pub mod dbe;
pub mod depth;
pub mod edges;
pub mod sharpness;
pub mod sparsification;
pub mod superpixel;

use crate::raster::{Map, Mask};

/// Smallest and largest value within the mask, finite ones alone; nothing where there is none.
fn depth_range(map: Map<'_>, mask: Mask<'_>) -> Option<(f32, f32)> {
    let values = map.into_iter().zip(mask).filter(|(v, keep)| **keep && v.is_finite()).map(|(v, _)| *v);
    values.map(|v| (v, v)).reduce(|(low, high), (v, _)| (v.min(low), v.max(high)))
}

#[cfg(test)]
mod tests {
    use super::{calibration, depth, sharpness, sparsification};
    use crate::Error;
    use ndarray::Array2;
    use sparsification::{Reduction, costs_by_uncertainty, sparsify};

    #[test]
    fn delta_is_strict() {
        let within = |k| depth::delta(&[1.25, 1.0], &[1.0, 1.0], k).unwrap();
        assert_eq!((within(1), within(2)), (0.5, 1.0));
    }

    #[test]
    fn faults_are_named() {
        assert!(matches!(depth::mse(&[1.0], &[1.0, 2.0]), Err(Error::Length { found: 1, expected: 2, .. })));
        assert!(matches!(depth::mse(&[], &[]), Err(Error::Empty(_))));
        assert!(matches!(depth::silog(&[1.0, -1.0], &[1.0, 2.0]), Err(Error::Value { index: 1, .. })));
        assert!(matches!(depth::abs_rel(&[1.0], &[f64::NAN]), Err(Error::Value { index: 0, .. })));
        let zero = calibration::nll(&[1.0], &[0.0]);
        assert!(matches!(zero, Err(Error::Value { what: "sigma", index: 0, .. })));
        let infinite = calibration::crps(&[f64::INFINITY], &[1.0]);
        assert!(matches!(infinite, Err(Error::Value { what: "the error", .. })));
        assert!(matches!(calibration::coverage(&[], &[], 0.5), Err(Error::Empty(_))));
        assert!(matches!(sparsify(&[1.0], &[], Reduction::Mean), Err(Error::Length { .. })));
        assert!(matches!(sparsify(&[], &[], Reduction::Mean), Err(Error::Empty(_))));
        let negative = sparsify(&[1.0, -1.0], &[1.0, 2.0], Reduction::Mean);
        assert!(matches!(negative, Err(Error::Value { index: 1, .. })));
        assert!(matches!(costs_by_uncertainty(&[1.0], &[1.0], 0), Err(Error::Config(_))));
        let (map, none) = (Array2::ones((4, 4)), Array2::from_elem((4, 4), false));
        assert!(matches!(sharpness::sharpness(map.view(), none.view()), Err(Error::Empty(_))));
    }
}
