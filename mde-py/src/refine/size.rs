//! Sizes, as the program has them.

use mde_cli::mde_prior::resample::{Filter, resize};
use ndarray::{Array3, ArrayView3, Axis, s};

/// Least width and height of an image, pixels.
pub(crate) const SMALLEST: usize = 8;
/// Longer side of a thumbnail, pixels.
const THUMBNAIL: usize = 240;

/// `(height, width)` with the longer side at most `longest`, the aspect kept.
pub(crate) fn within((height, width): (usize, usize), longest: Option<usize>) -> (usize, usize) {
    let longest = longest.unwrap_or(usize::MAX);
    let longer = height.max(width);
    if longer <= longest {
        return (height, width);
    }
    let scaled = |side: usize| ((2 * side * longest + longer) / (2 * longer)).max(1);
    (scaled(height), scaled(width))
}

/// `(height, width)` with at most that many million pixels, the aspect kept.
pub(crate) fn working((height, width): (usize, usize), megapixels: f64) -> (usize, usize) {
    let most = 1e6 * megapixels;
    let pixels = (height * width) as f64;
    if pixels <= most {
        return (height, width);
    }
    let side = |side: usize| ((side as f64 * (most / pixels).sqrt()).round() as usize).max(1);
    (side(height), side(width))
}

/// The image at that size.
pub(crate) fn shrink(image: &Array3<f32>, (height, width): (usize, usize)) -> Array3<f32> {
    let mut small = Array3::zeros((height, width, 3));
    for (mut to, from) in small.axis_iter_mut(Axis(2)).zip(image.axis_iter(Axis(2))) {
        to.assign(&resize(from, (height, width), Filter::BilinearAntialias));
    }
    small
}

/// A small version of a photograph, by means over blocks of pixels, in bytes.
pub(crate) fn thumbnail(image: ArrayView3<'_, f32>) -> Array3<u8> {
    let (rows, columns, _) = image.dim();
    let longer = rows.max(columns).max(1);
    let side = |side: usize| if longer > THUMBNAIL { (side * THUMBNAIL / longer).max(1) } else { side };
    let (height, width) = (side(rows), side(columns));
    let span = |index: usize, from: usize, to: usize| {
        let first = index * from / to;
        first..((index + 1) * from / to).max(first + 1)
    };
    let small = Array3::from_shape_fn((height, width, 3), |(y, x, c)| {
        let block = image.slice(s![span(y, rows, height), span(x, columns, width), c]);
        block.iter().sum::<f32>() / block.len().max(1) as f32
    });
    bytes(small.view())
}

/// sRGB in 0 to 1 as bytes.
pub(crate) fn bytes(image: ArrayView3<'_, f32>) -> Array3<u8> {
    image.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}
