//! Image operators of the metrics on maps: masks, gradients, Canny edges, distance
//! transforms, dilation, superpixels.

mod blur;
mod canny;
mod distance;
mod gradient;
mod slic;

pub(crate) use blur::blur;
#[cfg(feature = "scenes")]
pub(crate) use blur::blur_within;
pub(crate) use canny::canny;
pub(crate) use distance::Marked;
pub(crate) use distance::distance_to;
pub(crate) use gradient::sobel;
pub(crate) use slic::Superpixels;

use crate::{Error, Result};
use ndarray::{Array2, ArrayView2};

/// A map of depths or the like, `[height, width]`.
pub(crate) type Map<'a> = ArrayView2<'a, f32>;
/// Marked pixels, `[height, width]`.
pub(crate) type Mask<'a> = ArrayView2<'a, bool>;

/// Pixels of `mask` whose eight neighbours belong to it too, `[height, width]`.
///
/// What lies outside the image counts as part of the mask, as replicate padding has it. A 3 x 3 operator that is read
/// only here never reads a masked-out value.
pub(crate) fn erode(mask: Mask<'_>) -> Array2<bool> {
    let (height, width) = mask.dim();
    let rows = Array2::from_shape_fn((height, width), |(y, x)| {
        mask[(y, x)] && (x == 0 || mask[(y, x - 1)]) && (x + 1 == width || mask[(y, x + 1)])
    });
    Array2::from_shape_fn((height, width), |(y, x)| {
        rows[(y, x)] && (y == 0 || rows[(y - 1, x)]) && (y + 1 == height || rows[(y + 1, x)])
    })
}

/// The largest value within `radius` pixels (Euclidean) of each pixel, `[height, width]`.
pub(crate) fn dilate(map: Map<'_>, radius: u32) -> Array2<f32> {
    let mut out = map.to_owned();
    let reach = i64::from(radius);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            if dx * dx + dy * dy <= reach * reach && (dx, dy) != (0, 0) {
                max_with_shifted(&mut out, map, dy as isize, dx as isize);
            }
        }
    }
    out
}

/// `out[y][x] = max(out[y][x], map[y + dy][x + dx])` where both exist.
fn max_with_shifted(out: &mut Array2<f32>, map: Map<'_>, dy: isize, dx: isize) {
    let (height, width) = map.dim();
    let (tall, wide) = (dy.unsigned_abs(), dx.unsigned_abs());
    if tall >= height || wide >= width {
        return;
    }
    let range = |shift: isize, by: usize, size: usize| {
        if shift < 0 { (by..size, 0..size - by) } else { (0..size - by, by..size) }
    };
    let ((to_y, from_y), (to_x, from_x)) = (range(dy, tall, height), range(dx, wide, width));
    let source = map.slice(ndarray::s![from_y, from_x]);
    out.slice_mut(ndarray::s![to_y, to_x]).zip_mut_with(&source, |a, &b| *a = a.max(b));
}

/// Checks that `map` is as large as the truth.
pub(crate) fn same_shape(what: &'static str, map: (usize, usize), truth: (usize, usize)) -> Result<()> {
    if map == truth {
        return Ok(());
    }
    Err(Error::Shape { what, found: [map.0, map.1], expected: [truth.0, truth.1] })
}

/// The values of `map` where `mask` is true, row by row.
pub(crate) fn gather(map: Map<'_>, mask: Mask<'_>) -> Vec<f64> {
    map.iter().zip(mask).filter(|&(_, &keep)| keep).map(|(&value, _)| f64::from(value)).collect()
}
