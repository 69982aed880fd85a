//! Sizes of photographs, and pictures of them.

use mde_prior::resample::{Filter, resize};
use ndarray::{Array3, ArrayView3, Axis};

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

/// The image `[height, width, 3]` at that size.
pub fn shrink(image: ArrayView3<'_, f32>, (height, width): (usize, usize)) -> Array3<f32> {
    let mut small = Array3::zeros((height, width, 3));
    for (mut to, from) in small.axis_iter_mut(Axis(2)).zip(image.axis_iter(Axis(2))) {
        to.assign(&resize(from, (height, width), Filter::BilinearAntialias));
    }
    small
}

/// An image `[height, width, 3]` in 0 to 1 at another size: means over the pixels that fall together, else the nearest.
pub fn resized(image: ArrayView3<'_, f32>, width: usize, height: usize) -> Array3<f32> {
    let (rows, columns, _) = image.dim();
    if (rows, columns) == (height, width) {
        return image.to_owned();
    }
    let span = |index: usize, from: usize, to: usize| {
        let first = index * from / to;
        first..((index + 1) * from / to).max(first + 1)
    };
    let across: Vec<_> = (0..width).map(|x| span(x, columns, width)).collect();
    let mut small = Array3::zeros((height, width, 3));
    for (y, mut line) in small.outer_iter_mut().enumerate() {
        let down = span(y, rows, height);
        for (mut to, across) in line.outer_iter_mut().zip(&across) {
            let mut sums = [0.0_f32; 3];
            for row in down.clone() {
                for column in across.clone() {
                    sums.iter_mut().enumerate().for_each(|(c, sum)| *sum += image[(row, column, c)]);
                }
            }
            let count = (down.len() * across.len()).max(1) as f32;
            to.iter_mut().zip(sums).for_each(|(to, sum)| *to = sum / count);
        }
    }
    small
}

/// A colour in 0 to 1 as a byte.
pub fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A small version of a photograph `[height, width, 3]`, at most 240 pixels a side.
pub fn thumbnail(image: ArrayView3<'_, f32>) -> Array3<f32> {
    let (height, width, _) = image.dim();
    let longer = height.max(width).max(1);
    let side = |side: usize| if longer > THUMBNAIL { (side * THUMBNAIL / longer).max(1) } else { side };
    resized(image, side(width), side(height))
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

    #[test]
    fn shrinking_keeps_the_mean_and_growing_repeats() {
        let image = Array3::from_shape_fn((4, 6, 3), |(y, x, _)| (y * 6 + x) as f32 / 24.0);
        let small = resized(image.view(), 3, 2);
        assert!((small.mean().unwrap_or_default() - image.mean().unwrap_or_default()).abs() < 1e-6);
        let large = resized(image.view(), 12, 8);
        assert_eq!(large[(7, 11, 0)], image[(3, 5, 0)]);
        assert_eq!(large[(0, 1, 0)], image[(0, 0, 0)]);
    }
}
