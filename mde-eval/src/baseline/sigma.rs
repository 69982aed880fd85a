//! Trivial uncertainties: the baselines of a method's own.

use super::known;
use crate::raster::{erode, gather, same_shape, sobel};
use crate::{Error, Result};
use mde_uncertainty::statistics::median;
use ndarray::{Array2, ArrayView2, ArrayView3, Zip};

/// Typical sigma of all of them, as a fraction of the median depth.
const TYPICAL: f64 = 0.1;
/// Least sigma, as a fraction of the typical one: a flat wall is not exact.
const FLOOR: f64 = 0.01;

/// A standard deviation from the depth or the image alone, scaled to a mean of a tenth of the median depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrivialSigma {
    /// The same everywhere.
    Constant,
    /// Proportional to depth.
    Depth,
    /// Proportional to depth squared, as a disparity's error is.
    DepthSquared,
    /// Proportional to \\(|\nabla D|\\).
    DepthGradient,
    /// Proportional to \\(|\nabla I|\\), the gradient of luma.
    ImageGradient,
}

impl TrivialSigma {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Constant, Self::Depth, Self::DepthSquared, Self::DepthGradient, Self::ImageGradient];

    /// A short name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Depth => "depth",
            Self::DepthSquared => "squared depth",
            Self::DepthGradient => "depth gradient",
            Self::ImageGradient => "image gradient",
        }
    }

    /// The standard deviation `[height, width]` of a depth map, in its unit; 0 where the depth is missing.
    ///
    /// # Errors
    /// [`Error::Shape`] where image and depth differ, [`Error::Empty`] without depth.
    pub fn map(self, depth: ArrayView2<'_, f32>, image: ArrayView3<'_, f32>) -> Result<Array2<f32>> {
        let (height, width, _) = image.dim();
        same_shape("the depth", depth.dim(), (height, width))?;
        let mask = depth.mapv(known);
        let middle = median(gather(depth, mask.view())).ok_or(Error::Empty("an uncertainty"))?;
        let filled = depth.mapv(|d| if known(d) { d } else { middle as f32 });
        let shape = match self {
            Self::Constant => Array2::ones(depth.dim()),
            Self::Depth => filled,
            Self::DepthSquared => filled.mapv(|d| d * d),
            // A hole's rim is no slope of the depth.
            Self::DepthGradient => sobel(filled.view()) * erode(mask.view()).mapv(|m| f32::from(u8::from(m))),
            Self::ImageGradient => {
                let planes = super::channels(image);
                let mut luma = Array2::zeros(depth.dim());
                for (plane, weight) in planes.iter().zip([0.299, 0.587, 0.114]) {
                    luma.scaled_add(weight, plane);
                }
                sobel(luma.view())
            }
        };
        let values = gather(shape.view(), mask.view());
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let typical = TYPICAL * middle;
        // Where all pixels are alike, the same everywhere.
        let (scale, offset) = if mean > 0.0 { (typical / mean, 0.0) } else { (0.0, typical) };
        Ok(Zip::from(&shape).and(&mask).map_collect(|&v, &keep| {
            if keep { (scale * f64::from(v) + offset).max(FLOOR * typical) as f32 } else { 0.0 }
        }))
    }
}
