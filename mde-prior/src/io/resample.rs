//! Resizing of float planes, as in the networks' own preprocessing.

use mde_uncertainty::filter::line;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};
use serde::{Deserialize, Serialize};

/// An interpolation kernel. Pixel centres are at half-integers of the area: the half-pixel convention of OpenCV and of
/// PyTorch with `align_corners = false`, borders repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Filter {
    /// Two taps an axis.
    #[default]
    Bilinear,
    /// Two taps an axis, corner pixels on corner pixels (PyTorch's `align_corners = true`).
    BilinearAlignCorners,
    /// The triangle widened by the reduction where the image shrinks, so that fine texture does not alias (Pillow).
    BilinearAntialias,
    /// Four taps an axis, Keys' kernel with \\( a = -0.75 \\) (OpenCV, PyTorch); it overshoots at edges.
    Bicubic,
}

/// Resizes to `(height, width)`; a map of that size is copied.
///
/// Every output pixel is a weighted mean of input pixels with weights that sum to 1, so constants are kept.
///
/// ```
/// use mde_prior::ndarray::array;
/// use mde_prior::resample::{Filter, resize};
///
/// let wide = resize(array![[0.0_f32, 1.0]].view(), (1, 4), Filter::Bilinear);
/// assert_eq!(wide, array![[0.0, 0.25, 0.75, 1.0]]);
/// ```
#[must_use]
pub fn resize(map: ArrayView2<'_, f32>, size: (usize, usize), filter: Filter) -> Array2<f32> {
    if map.is_empty() || size.0 == 0 || size.1 == 0 {
        return Array2::zeros(size);
    }
    if map.dim() == size {
        return map.to_owned();
    }
    let columns = taps(map.ncols(), size.1, filter);
    let rows = taps(map.nrows(), size.0, filter);
    let mut narrow = vec![0.0_f32; map.nrows() * size.1];
    for (row, out) in map.outer_iter().zip(narrow.chunks_exact_mut(size.1)) {
        let from = line(row);
        out.iter_mut().zip(&columns).for_each(|(out, taps)| *out = taps.mean(&from));
    }
    let mut resized = vec![0.0_f32; size.0 * size.1];
    for (out, Taps { first, weights }) in resized.chunks_exact_mut(size.1).zip(&rows) {
        for (row, &weight) in narrow[first * size.1..].chunks_exact(size.1).zip(weights) {
            out.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
        }
    }
    // There are as many values as that.
    Array2::from_shape_vec(size, resized).unwrap_or_default()
}

/// Resizes an image `[height, width, channels]` to `(height, width)` without aliases.
#[must_use]
pub fn shrink(image: ArrayView3<'_, f32>, (height, width): (usize, usize)) -> Array3<f32> {
    let mut small = Array3::zeros((height, width, image.dim().2));
    for (mut to, from) in small.axis_iter_mut(Axis(2)).zip(image.axis_iter(Axis(2))) {
        to.assign(&resize(from, (height, width), Filter::BilinearAntialias));
    }
    small
}

/// Resizes to `(height, width)` with the value of the pixel that contains the new pixel's centre: for depth, which must not be mixed
/// across an edge or with missing pixels.
#[must_use]
pub fn nearest<T: Copy + Default>(map: ArrayView2<'_, T>, (height, width): (usize, usize)) -> Array2<T> {
    let (rows, columns) = map.dim();
    let source =
        |to: usize, of: usize, from: usize| ((2 * to + 1) * from / (2 * of)).min(from.saturating_sub(1));
    Array2::from_shape_fn((height, width), |(y, x)| {
        map.get((source(y, height, rows), source(x, width, columns))).copied().unwrap_or_default()
    })
}

/// Weights of consecutive input pixels.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Taps {
    fn mean(&self, line: &[f32]) -> f32 {
        let from = &line[self.first..];
        match (&self.weights[..], from) {
            // The usual case.
            ([a, b], [v, w, ..]) => v * a + w * b,
            (weights, from) => from.iter().zip(weights).map(|(v, w)| v * w).sum(),
        }
    }
}

fn taps(input: usize, output: usize, filter: Filter) -> Vec<Taps> {
    let ratio = input as f64 / output as f64;
    let widen = if filter == Filter::BilinearAntialias { ratio.max(1.0) } else { 1.0 };
    let reach = if filter == Filter::Bicubic { 2.0 } else { widen };
    let last = input as i64 - 1;
    let at = |i: usize| {
        let centre = match filter {
            Filter::BilinearAlignCorners if output > 1 => i as f64 * last as f64 / (output - 1) as f64,
            Filter::BilinearAlignCorners => 0.0,
            _ => (i as f64 + 0.5) * ratio - 0.5,
        };
        let (low, high) = ((centre - reach).ceil() as i64, (centre + reach).floor() as i64);
        // Pillow cuts the widened triangle off at the border, the others repeat the border pixel.
        let range = if widen > 1.0 { low.max(0)..=high.min(last) } else { low..=high };
        let first = low.clamp(0, last);
        let mut weights = vec![0.0_f64; (high.clamp(0, last) - first + 1) as usize];
        for j in range {
            weights[(j.clamp(0, last) - first) as usize] += kernel((j as f64 - centre) / widen, filter);
        }
        let sum: f64 = weights.iter().sum();
        Taps { first: first as usize, weights: weights.iter().map(|w| (w / sum) as f32).collect() }
    };
    (0..output).map(at).collect()
}

fn kernel(x: f64, filter: Filter) -> f64 {
    let x = x.abs();
    match filter {
        Filter::Bicubic if x <= 1.0 => (1.25 * x - 2.25) * x * x + 1.0,
        Filter::Bicubic if x < 2.0 => -0.75 * (((x - 5.0) * x + 8.0) * x - 4.0),
        Filter::Bicubic => 0.0,
        _ => (1.0 - x).max(0.0),
    }
}
