use super::gradient::Gradient;
use super::{blur, same_shape};
use crate::Result;
use crate::raster::{Map, Mask};
use ndarray::Array2;

/// Canny's edge detector (1986), as scikit-image has it, with a mask: `[height, width]` in, edge pixels out.
///
/// Gaussian smoothing with `sigma` pixels that ignores what is masked out (normalised convolution, cut off at 4 sigma), Sobel
/// gradients (gain 8), non-maximum suppression between interpolated neighbours, and hysteresis: pixels of at least
/// `low` that touch, over eight neighbours, a pixel of at least `high`. Pixels on the border of the image or of the
/// mask are no edges.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the mask differs.
pub(crate) fn canny(map: Map<'_>, mask: Mask<'_>, sigma: f64, low: f64, high: f64) -> Result<Array2<bool>> {
    same_shape("the mask", mask.dim(), map.dim())?;
    let weights = mask.mapv(|keep| f64::from(u8::from(keep)));
    let mut values = map.mapv(f64::from);
    values.zip_mut_with(&mask, |value, keep| *value = if *keep && value.is_finite() { *value } else { 0.0 });
    let (mut smooth, share) = (blur(values, sigma), blur(weights, sigma));
    smooth.zip_mut_with(&share, |value, share| *value /= share + f64::EPSILON);
    let strength = Gradient::sobel(&smooth).thin(mask, low);
    Ok(hysteresis(&strength, high))
}

/// Pixels above 0 that are joined, over eight neighbours, to one of at least `high`.
fn hysteresis(strength: &Array2<f64>, high: f64) -> Array2<bool> {
    let (height, width) = strength.dim();
    let mut edges = Array2::from_elem((height, width), false);
    let mut open: Vec<(usize, usize)> =
        strength.indexed_iter().filter(|(_, s)| **s > 0.0 && **s >= high).map(|(at, _)| at).collect();
    while let Some((y, x)) = open.pop() {
        if std::mem::replace(&mut edges[(y, x)], true) {
            continue;
        }
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if strength[(v, u)] > 0.0 && !edges[(v, u)] {
                    open.push((v, u));
                }
            }
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_one_thin_line_and_a_mask_makes_none() {
        let map = Array2::from_shape_fn((30, 40), |(_, x)| if x < 20 { 0.0 } else { 1.0 });
        let mask = Array2::from_elem((30, 40), true);
        let edges = canny(map.view(), mask.view(), 2_f64.sqrt(), 0.15, 0.3).unwrap();
        for row in edges.rows().into_iter().skip(1).take(28) {
            let at: Vec<usize> = row.iter().enumerate().filter(|(_, e)| **e).map(|(x, _)| x).collect();
            // Both pixels of the step are as steep, but for rounding.
            assert!(!at.is_empty() && at.iter().all(|x| (19..=20).contains(x)), "{at:?}");
        }
        // The same step, but nothing is known right of it.
        let half = Array2::from_shape_fn((30, 40), |(_, x)| x < 20);
        assert!(!canny(map.view(), half.view(), 2_f64.sqrt(), 0.15, 0.3).unwrap().iter().any(|e| *e));
    }

    #[test]
    fn weak_edges_need_a_strong_one() {
        let ramp = |height: f32| Array2::from_shape_fn((20, 40), |(_, x)| if x < 20 { 0.0 } else { height });
        let mask = Array2::from_elem((20, 40), true);
        let found = |height, high| {
            canny(ramp(height).view(), mask.view(), 1.5, 0.1, high).unwrap().iter().any(|e| *e)
        };
        assert!(found(0.2, 0.3) && !found(0.2, 0.6));
        for (height, width) in [(1, 1), (1, 9), (0, 5), (2, 2)] {
            let (map, mask) = (Array2::ones((height, width)), Array2::from_elem((height, width), true));
            assert_eq!(canny(map.view(), mask.view(), 1.0, 0.1, 0.2).unwrap().dim(), (height, width));
        }
    }
}
