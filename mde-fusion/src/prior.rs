use crate::{Error, Result};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, ArrayView2};

/// The monocular depth \\(D_o\\), with or without a variance per pixel.
///
/// `[height, width]`, z-depth in any unit, 0 where missing. Without a variance, the fusion estimates
/// \\(\sigma_o^2\\) from the views (Eq. 15). With one, as from a previous iteration, it is used as it is, and a variance of 0
/// is an exact depth.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    mean: Array2<f32>,
    variance: Option<Array2<f32>>,
}

impl Prior {
    /// A depth map `[height, width]` of unknown variance; 0 is missing.
    ///
    /// # Errors
    /// [`Error::Depth`] for a depth that is negative or not finite.
    pub fn new(mean: Array2<f32>) -> Result<Self> {
        check(&mean, |_, d| d.is_finite() && d >= 0.0)?;
        Ok(Self { mean, variance: None })
    }

    /// A depth map with its variance, such as a [`Fused`](crate::Fused)'s `depth` for the next iteration.
    ///
    /// # Errors
    /// [`Error::Depth`] for a depth that is not positive where the variance is finite.
    pub fn with_variance(depth: GaussianDepth) -> Result<Self> {
        let (mean, variance) = depth.into_parts();
        check(&mean, |pixel, d| d > 0.0 || variance.get(pixel).is_none_or(|v| v.is_infinite()))?;
        Ok(Self { mean, variance: Some(variance) })
    }

    /// The depth, `[height, width]`; 0 where missing.
    pub fn mean(&self) -> ArrayView2<'_, f32> {
        self.mean.view()
    }

    /// The variance, `[height, width]`, if there is one; infinite where missing.
    pub fn variance(&self) -> Option<ArrayView2<'_, f32>> {
        self.variance.as_ref().map(|variance| variance.view())
    }

    /// `(height, width)`.
    pub fn dim(&self) -> (usize, usize) {
        self.mean.dim()
    }
}

fn check(mean: &Array2<f32>, valid: impl Fn((usize, usize), f32) -> bool) -> Result<()> {
    match mean.indexed_iter().find(|&(pixel, &value)| !valid(pixel, value)) {
        Some(((row, column), &value)) => Err(Error::Depth { row, column, value }),
        None => Ok(()),
    }
}
