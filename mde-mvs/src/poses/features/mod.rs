//! Points of a photograph that can be found again: the scale-invariant feature transform (Lowe, 2004).
//!
//! Extrema of differences of Gaussians over space and scale, refined by a quadratic; the dominant directions of the gradient about each; a
//! histogram of gradients on 4 x 4 cells of 8 directions, as RootSIFT (Arandjelovic and Zisserman, 2012). The constants are OpenCV's, whose
//! keypoints and descriptors a test compares. The descriptor does not change under a gain or an offset of the photograph.

mod descriptor;
mod extrema;
mod scale_space;

use crate::Result;
use mde_uncertainty::OutOfRange;
use nalgebra::Point2;
use ndarray::{Array2, ArrayView3, Axis};
use rayon::prelude::*;
use scale_space::ScaleSpace;

/// Pixels of the finest level at most. A photograph is enlarged twice where that stays below it, as Lowe does, and reduced where
/// the photograph itself exceeds it.
const FINEST_PIXELS: usize = 1_300_000;

/// Where a feature is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Keypoint {
    /// Column and row in the photograph; pixel centres at integers.
    pub(super) pixel: Point2<f64>,
    /// Standard deviation of the Gaussian at which it is an extremum, pixels.
    pub(super) scale: f64,
    /// Direction of the gradient about it, radians from the column axis to the row axis, in \\( [0, 2 \pi) \\).
    pub(super) angle: f64,
    /// Contrast of the extremum.
    pub(super) response: f64,
}

/// The features of one photograph.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Features {
    /// Where they are, strongest first.
    pub(super) keypoints: Vec<Keypoint>,
    /// `[keypoints, 128]`: square roots of histograms of sum 1, so the Euclidean norm is 1.
    pub(super) descriptors: Array2<f32>,
}

impl Features {
    /// The `max_features` strongest features of an `[h, w, 3]` image of sRGB colours in \\( [0, 1] \\).
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) for an image with another number of channels than 3 or a side below 16 pixels.
    pub(super) fn detect(image: ArrayView3<f32>, max_features: usize) -> Result<Self> {
        Self::detect_within(image, max_features, FINEST_PIXELS)
    }

    /// That many of the largest scale, which are found again over the widest range of views.
    pub(super) fn coarsest(&self, count: usize) -> Self {
        let mut order: Vec<usize> = (0..self.keypoints.len()).collect();
        order.sort_by(|&a, &b| self.keypoints[b].scale.total_cmp(&self.keypoints[a].scale));
        order.truncate(count);
        let keypoints = order.iter().map(|&i| self.keypoints[i]).collect();
        Self { keypoints, descriptors: self.descriptors.select(Axis(0), &order) }
    }

    fn detect_within(image: ArrayView3<f32>, max_features: usize, finest_pixels: usize) -> Result<Self> {
        let (height, width, channels) = image.dim();
        let side = height.min(width);
        OutOfRange::check(channels == 3, "image channels", &channels, "give red, green and blue")?;
        OutOfRange::check(side >= 16, "smaller side of a photograph", &side, "give 16 pixels or more")?;
        let space = ScaleSpace::new(image, finest_pixels);
        let mut found = extrema::find(&space);
        // Equal responses keep the order of the scan, so the choice is the same every time.
        found.sort_by(|a, b| b.response.total_cmp(&a.response));
        found.truncate(max_features);

        let described: Vec<_> = found.par_iter().map(|found| descriptor::describe(&space, found)).collect();
        let keypoints = found.iter().map(|found| space.keypoint(found)).collect();
        Ok(Self { keypoints, descriptors: Array2::from(described) })
    }
}

#[cfg(test)]
mod tests;
