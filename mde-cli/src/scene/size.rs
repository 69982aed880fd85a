//! Sizes of photographs, and pictures of them.

use mde_prior::pixels::Image;
use mde_prior::resample::shrink;
use ndarray::{Array3, ArrayView3};

/// Least width and height of an image, pixels.
pub const SMALLEST: usize = 8;
/// Longer side of a thumbnail, pixels.
const THUMBNAIL: usize = 240;

/// The sizes of results and of refinements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// Longer side of the results, pixels.
    pub longest: Option<usize>,
    /// Most million pixels of a refinement.
    pub megapixels: f64,
}

impl Default for Sizes {
    fn default() -> Self {
        Self { longest: None, megapixels: 1.5 }
    }
}

impl Sizes {
    /// `(height, width)` of the results for a photograph of that size.
    pub fn of_results(&self, size: (usize, usize)) -> (usize, usize) {
        within(size, self.longest.unwrap_or(usize::MAX))
    }

    /// `(height, width)` of the refinement for results of that size.
    pub fn of_refinement(&self, (height, width): (usize, usize)) -> (usize, usize) {
        let (most, pixels) = (1e6 * self.megapixels, (height * width) as f64);
        if pixels <= most {
            return (height, width);
        }
        let side = |side: usize| ((side as f64 * (most / pixels).sqrt()).round() as usize).max(1);
        (side(height), side(width))
    }

    /// A photograph at the size of its refinement.
    pub fn refined(&self, image: Image) -> Image {
        let size = self.of_results((image.dim().0, image.dim().1));
        shrunk(shrunk(image, size), self.of_refinement(size))
    }
}

/// An image of `(height, width)`, the same where it has that size.
pub(crate) fn shrunk(image: Image, (height, width): (usize, usize)) -> Image {
    let fits = image.dim() == (height, width, 3);
    if fits { image } else { shrink(image.view(), (height, width)).into_shared() }
}

/// `(height, width)` with the longer side at most `longest`, the aspect kept.
pub(crate) fn within((height, width): (usize, usize), longest: usize) -> (usize, usize) {
    let longer = height.max(width);
    if longer <= longest {
        return (height, width);
    }
    let scaled = |side: usize| ((2 * side * longest + longer) / (2 * longer)).max(1);
    (scaled(height), scaled(width))
}

/// A colour in 0 to 1 as a byte.
pub fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A small version of a photograph `[height, width, 3]`, at most 240 pixels a side.
pub fn thumbnail(image: ArrayView3<'_, f32>) -> Array3<f32> {
    let (height, width, _) = image.dim();
    shrink(image, within((height, width), THUMBNAIL))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longer_side_is_bounded_and_the_aspect_kept() {
        assert_eq!(within((3648, 5472), 1600), (1067, 1600));
        assert_eq!(within((480, 640), 640), (480, 640));
        assert_eq!(within((16000, 20), 100), (100, 1));
    }
}
