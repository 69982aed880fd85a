//! Image operators of the metrics: masks, gradients and their ridges, distance transforms, dilation.

mod distance;
mod gradient;

pub(crate) use distance::distance_to;
pub(crate) use gradient::{Gradient, sobel};

use crate::{Error, Result};
use mde_uncertainty::filter::{Border, Gaussian, gaussian_blur};
use ndarray::{Array2, ArrayView2, Axis, s};

/// A map of depths or the like, `[height, width]`.
pub(crate) type Map<'a> = ArrayView2<'a, f32>;
/// Marked pixels, `[height, width]`.
pub(crate) type Mask<'a> = ArrayView2<'a, bool>;

/// Pixels of `mask` whose eight neighbours belong to it too, `[height, width]`.
///
/// What lies outside the image counts as part of the mask, as replicate padding has it. A 3 x 3 operator that is read
/// only here never reads a masked-out value.
pub(crate) fn erode(mask: Mask<'_>) -> Array2<bool> {
    smallest(mask.to_owned(), 1)
}

/// The smallest value, `false` below `true`, in a square of side `2 * radius + 1` about each pixel, cut off at the border.
pub(crate) fn smallest<T: Copy + PartialOrd>(mut map: Array2<T>, radius: usize) -> Array2<T> {
    for axis in [Axis(0), Axis(1)] {
        for mut line in map.lanes_mut(axis) {
            let source = line.to_vec();
            for (at, value) in line.iter_mut().enumerate() {
                let window = &source[at.saturating_sub(radius)..(at + radius + 1).min(source.len())];
                *value =
                    window.iter().fold(*value, |least, other| if *other < least { *other } else { least });
            }
        }
    }
    map
}

/// The largest value within `radius` pixels (Euclidean) of each pixel, `[height, width]`.
pub(crate) fn dilate(map: Map<'_>, radius: u32) -> Array2<f32> {
    let mut out = map.to_owned();
    let (height, width) = map.dim();
    let reach = i64::from(radius);
    // The pixels of a side that have one so far along, and those.
    let shifted = |shift: i64, side: usize| {
        let by = (shift.unsigned_abs() as usize).min(side);
        if shift < 0 { (by..side, 0..side - by) } else { (0..side - by, by..side) }
    };
    for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
        if dx * dx + dy * dy <= reach * reach {
            let ((to_y, from_y), (to_x, from_x)) = (shifted(dy, height), shifted(dx, width));
            out.slice_mut(s![to_y, to_x]).zip_mut_with(&map.slice(s![from_y, from_x]), |a, &b| *a = a.max(b));
        }
    }
    out
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

/// Gaussian blur with zeros outside.
pub(crate) fn blur(map: &Array2<f64>, gaussian: Gaussian) -> Array2<f64> {
    gaussian_blur(map.view(), gaussian, gaussian, Border::Zero)
}

/// Gaussian blur of the pixels with a weight, the others left out (normalised convolution); 0 far from all of them.
#[cfg(feature = "prior")]
pub(crate) fn blur_known(map: &Array2<f64>, weights: &Array2<f64>, gaussian: Gaussian) -> Array2<f64> {
    mean_of(blur(&(map * weights), gaussian), &blur(weights, gaussian))
}

/// Sums over their weights; 0 where nothing has a weight.
#[cfg(feature = "prior")]
pub(crate) fn mean_of(mut sums: Array2<f64>, weights: &Array2<f64>) -> Array2<f64> {
    sums.zip_mut_with(weights, |sum, weight| *sum = if *weight > 0.0 { *sum / weight } else { 0.0 });
    sums
}

/// A Gaussian that is cut off at four sigma, rounded.
pub(crate) fn four_sigma(sigma: f64) -> Gaussian {
    Gaussian { sigma, radius: (4.0 * sigma + 0.5) as usize }
}
