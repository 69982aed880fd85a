//! Errors near edges that forgive a pixel of displacement.

use crate::raster::{distance_to, same_shape};
use crate::{Error, Result};
use ndarray::ArrayView2;

/// How far from a true edge a pixel counts, pixels (the published dilation).
pub const BAND: f64 = 10.0;

/// Soft edge error (Chen, Chen and Cheng, "On the over-smoothing problem of CNN based disparity estimation", ICCV 2019; as
/// PatchFusion has it), in the depths' unit:
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
    same_shape("the edge map", edges.dim(), truth.dim())?;
    soft_edge_error_within(prediction, truth, mask, distance_to(edges).view())
}

/// [`soft_edge_error`] with the distance to the edges.
pub(crate) fn soft_edge_error_within(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    to_edges: ArrayView2<'_, f64>,
) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    same_shape("the mask", mask.dim(), truth.dim())?;
    same_shape("the edge map", to_edges.dim(), truth.dim())?;
    let (height, width) = truth.dim();
    let (mut sum, mut count) = (0.0, 0_usize);
    for ((y, x), &distance) in to_edges.indexed_iter() {
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
    use proptest::prelude::*;

    proptest! {
        /// The pixel's own true depth is one of those that it is compared with.
        #[test]
        fn it_is_no_larger_than_the_mean_error_of_the_band(
            depths in proptest::collection::vec((0.5..5.0_f32, 0.5..5.0_f32, 0..9_u8), 13 * 26)
        ) {
            let map = |of: fn(&(f32, f32, u8)) -> f32| {
                Array2::from_shape_vec((13, 26), depths.iter().map(of).collect()).unwrap()
            };
            let (p, g, keep) = (map(|d| d.0), map(|d| d.1), map(|d| f32::from(d.2)).mapv(|k| k > 0.0));
            let edges = Array2::from_shape_fn((13, 26), |(_, x)| x == 3);
            let error = |p: &Array2<f32>| soft_edge_error(p.view(), g.view(), keep.view(), edges.view()).unwrap();
            let band: Vec<f64> = (0..13).flat_map(|y| (0..14).map(move |x| (y, x)))
                .filter(|at| keep[*at]).map(|at| f64::from((p[at] - g[at]).abs())).collect();
            let plain = band.iter().sum::<f64>() / band.len() as f64;
            prop_assert!(error(&p).is_some_and(|e| (0.0..=plain + 1e-12).contains(&e)));
            prop_assert_eq!(error(&g), Some(0.0));
        }
    }

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
