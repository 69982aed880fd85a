//! Errors near edges that forgive a pixel of displacement.

use crate::raster::{distance_to, same_shape};
use crate::{Error, Result};
use ndarray::ArrayView2;

/// How far from a true edge a pixel counts, pixels (the published dilation).
pub const BAND: f64 = 10.0;

/// Soft edge error (Chen et al., "Over-parameterised correspondence networks", CVPR 2019; as PatchFusion has it), in the depths' unit:
///
/// \\[ \frac{1}{|B|} \sum_{x \in B} \min_{\|u\|_\infty \le 1} |g(x + u) - p(x)| \\]
///
/// over the pixels \\(B\\) of the mask within [`BAND`] of a true edge. `edges` are the truth's
/// ([`edges::edges`](super::edges::edges)); the published ones are jumps of stereo disparity by a pixel, which a depth
/// map alone does not have. Neighbours outside the mask are not tried. All maps are `[height, width]`; nothing where \\(B\\)
/// is empty.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ.
pub fn soft_edge_error(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    edges: ArrayView2<'_, bool>,
) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    same_shape("the mask", mask.dim(), truth.dim())?;
    same_shape("the edge map", edges.dim(), truth.dim())?;
    let near = distance_to(edges);
    let (height, width) = truth.dim();
    let (mut sum, mut count) = (0.0, 0_usize);
    for ((y, x), &distance) in near.indexed_iter() {
        if !mask[(y, x)] || distance > BAND {
            continue;
        }
        let mut least = f32::INFINITY;
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if mask[(v, u)] {
                    least = least.min((truth[(v, u)] - prediction[(y, x)]).abs());
                }
            }
        }
        sum += f64::from(least);
        count += 1;
    }
    if sum.is_finite() {
        return Ok((count > 0).then(|| sum / count as f64));
    }
    Err(Error::Value { what: "a depth", index: 0, value: sum, expected: "finite within the mask" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_pixel_of_displacement_is_forgiven_and_two_are_not() {
        let step = |at: usize| Array2::from_shape_fn((20, 60), |(_, x)| if x < at { 1.0_f32 } else { 3.0 });
        let mask = Array2::from_elem((20, 60), true);
        let edges = Array2::from_shape_fn((20, 60), |(_, x)| x == 30);
        let error =
            |at| soft_edge_error(step(at).view(), step(30).view(), mask.view(), edges.view()).unwrap();
        assert_eq!((error(30), error(31)), (Some(0.0), Some(0.0)));
        // Of 21 columns near the edge, one is wrong by 2 m.
        assert!((error(32).unwrap() - 2.0 / 21.0).abs() < 1e-12);
        let none = Array2::from_elem((20, 60), false);
        assert_eq!(soft_edge_error(step(3).view(), step(3).view(), mask.view(), none.view()).unwrap(), None);
    }
}
