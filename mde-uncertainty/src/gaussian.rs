use crate::{Error, Result};
use ndarray::{Array2, ArrayView2, Zip};

/// A depth map with a variance per pixel, both `[height, width]`.
///
/// The mean is z-depth (along the optical axis, never along the ray) in the prior's unit; the variance is in that unit squared. A missing
/// pixel has infinite variance, that is precision 0, and mean 0; a variance of 0 is an exact depth. No value is NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct GaussianDepth {
    mean: Array2<f32>,
    variance: Array2<f32>,
}

impl GaussianDepth {
    /// A mean and a variance, both `[height, width]`.
    ///
    /// Pixels of infinite variance are missing; their mean becomes 0, whatever its value.
    ///
    /// # Errors
    /// [`Error::Size`] where the shapes differ, [`Error::Variance`] for a NaN or negative variance, [`Error::Mean`]
    /// for a mean that is not finite at a pixel that is not missing.
    pub fn new(mut mean: Array2<f32>, variance: Array2<f32>) -> Result<Self> {
        if mean.dim() != variance.dim() {
            return Err(Error::Size { what: "the variance", found: variance.dim(), expected: mean.dim() });
        }
        for (((row, column), m), &v) in mean.indexed_iter_mut().zip(variance.iter()) {
            if v.is_nan() || v < 0.0 {
                return Err(Error::Variance { row, column, value: v });
            }
            if v == f32::INFINITY {
                *m = 0.0;
            } else if !m.is_finite() {
                return Err(Error::Mean { row, column, value: *m });
            }
        }
        Ok(Self { mean, variance })
    }

    /// A map of `[height, width]` missing pixels.
    pub fn missing(height: usize, width: usize) -> Self {
        Self {
            mean: Array2::zeros((height, width)),
            variance: Array2::from_elem((height, width), f32::INFINITY),
        }
    }

    /// The mean, `[height, width]`; 0 where missing.
    pub fn mean(&self) -> ArrayView2<'_, f32> {
        self.mean.view()
    }

    /// The variance, `[height, width]`; infinite where missing.
    pub fn variance(&self) -> ArrayView2<'_, f32> {
        self.variance.view()
    }

    /// The standard deviation, `[height, width]`; infinite where missing.
    pub fn sigma(&self) -> Array2<f32> {
        self.variance.mapv(f32::sqrt)
    }

    /// `(height, width)`.
    pub fn dim(&self) -> (usize, usize) {
        self.mean.dim()
    }

    /// Mean and variance at `(row, column)`; `None` where missing or outside of the map.
    #[inline]
    pub fn get(&self, row: usize, column: usize) -> Option<(f32, f32)> {
        let variance = *self.variance.get((row, column))?;
        (variance != f32::INFINITY).then(|| (self.mean[(row, column)], variance))
    }

    /// True where the map is not missing, `[height, width]`.
    pub fn support(&self) -> Array2<bool> {
        self.variance.mapv(|v| v != f32::INFINITY)
    }

    /// Applies `f` to every mean and variance. Missing pixels are unchanged; pixels that `f` makes non-finite become missing.
    pub fn map(mut self, mut f: impl FnMut(f32, f32) -> (f32, f32)) -> Self {
        Zip::from(&mut self.mean).and(&mut self.variance).for_each(|mean, variance| {
            if *variance == f32::INFINITY {
                return;
            }
            let (m, v) = f(*mean, *variance);
            let known = m.is_finite() && v.is_finite() && v >= 0.0;
            (*mean, *variance) = if known { (m, v) } else { (0.0, f32::INFINITY) };
        });
        self
    }

    /// The two maps, mean first.
    pub fn into_parts(self) -> (Array2<f32>, Array2<f32>) {
        (self.mean, self.variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn invalid_values_are_named() {
        let nan = GaussianDepth::new(array![[1.0, f32::NAN]], array![[0.1, 0.1]]);
        assert!(matches!(nan, Err(Error::Mean { row: 0, column: 1, .. })));
        let negative = GaussianDepth::new(array![[1.0], [2.0]], array![[0.1], [-0.5]]);
        assert_eq!(negative, Err(Error::Variance { row: 1, column: 0, value: -0.5 }));
        let shape = GaussianDepth::new(Array2::zeros((2, 3)), Array2::zeros((3, 2)));
        assert_eq!(shape, Err(Error::Size { what: "the variance", found: (3, 2), expected: (2, 3) }));
    }

    #[test]
    fn a_missing_pixel_has_the_mean_zero() {
        let map = GaussianDepth::new(array![[f32::NAN, 2.0]], array![[f32::INFINITY, 0.25]]).unwrap();
        assert_eq!([map.get(0, 0), map.get(7, 7)], [None; 2]);
        assert_eq!(map.mean()[(0, 0)], 0.0);
        assert_eq!(map.get(0, 1), Some((2.0, 0.25)));
        assert_eq!(map.sigma()[(0, 1)], 0.5);
    }

    #[test]
    fn pixels_that_become_infinite_are_missing() {
        let map = GaussianDepth::new(array![[0.0, 2.0]], array![[1.0, 1.0]]).unwrap();
        let inverse = map.map(|m, v| (1.0 / m, v / m.powi(4)));
        assert_eq!(inverse.support(), array![[false, true]]);
    }
}
