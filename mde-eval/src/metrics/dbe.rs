//! Depth boundary errors.

use super::depth_range;
use super::edges::Edges;
use crate::Result;
use crate::raster::{Gradient, Map, Mask, blur, four_sigma, same_shape};
use ndarray::Array2;
use std::f64::consts::SQRT_2;

/// How far predicted depth boundaries lie from the true ones, and the other way round, in pixels; 0 is best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundaryErrors {
    /// Mean distance of predicted boundary pixels to the nearest true one, those beyond the limit left out.
    pub accuracy: f64,
    /// Mean distance, cut off at the limit, of all predicted and true boundary pixels to the other side.
    pub completeness: f64,
}

/// Distance from which on a boundary pixel has no counterpart, pixels: the published \\(\theta\\).
pub const LIMIT: f64 = 10.0;

/// Boundary pixels of a depth map: Canny's (1986), as scikit-image has it, of the depth scaled to 0 to 1 over the mask. Blind to scale
/// and shift of the map.
///
/// Gaussian smoothing (\\(\sigma = \sqrt2\\), cut off at 4 sigma) that ignores what is masked out (normalised convolution), Sobel
/// gradients (gain 8), non-maximum suppression between interpolated neighbours, and hysteresis: pixels of at least 0.15 that touch,
/// over eight neighbours, a pixel of at least 0.3. Pixels on the border of the image or of the mask are no edges.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the mask differs.
pub fn boundaries(map: Map<'_>, mask: Mask<'_>) -> Result<Edges> {
    same_shape("the mask", mask.dim(), map.dim())?;
    let Some((low, high)) = depth_range(map, mask).filter(|(low, high)| high > low) else {
        return Ok(Edges::new(Array2::from_elem(map.dim(), false)));
    };
    let mut values = map.mapv(|d| f64::from((d - low) / (high - low)));
    values.zip_mut_with(&mask, |value, keep| *value = if *keep && value.is_finite() { *value } else { 0.0 });
    let weights = mask.mapv(|keep| f64::from(u8::from(keep)));
    let [mut smooth, share] = [values, weights].map(|map| blur(&map, four_sigma(SQRT_2)));
    smooth.zip_mut_with(&share, |value, share| *value /= share + f64::EPSILON);
    Ok(Edges::new(hysteresis(&Gradient::sobel(&smooth).thin(mask, 0.15), 0.3)))
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

/// Depth boundary errors of Koch et al., "Evaluation of CNN-based single-image depth estimation methods" (ECCV Workshops 2018;
/// iBims-1), of boundary pixels `predicted` against the `truth`'s:
///
/// \\[ \varepsilon_{acc} = \frac{\sum_{x \in E_p,\\,d_g(x) < \theta} d_g(x)}{|\\{x \in E_p : d_g(x) < \theta\\}|},\qquad
///     \varepsilon_{com} = \frac{\sum_{x \in E_p} \min(d_g, \theta) + \sum_{x \in E_g} \min(d_p, \theta)}{|E_p| + |E_g|} \\]
///
/// with \\(d_g, d_p\\) the distances to the true and the predicted boundaries and \\(\theta\\) = [`LIMIT`]. Both are \\(\theta\\) where
/// nothing is predicted, the first also where nothing that is predicted lies within \\(\theta\\). Nothing where the truth has no
/// boundary. The benchmark's true boundaries are drawn by hand; those of a data set without them come from [`boundaries`].
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the shapes differ.
pub fn boundary_errors(predicted: &Edges, truth: &Edges) -> Result<Option<BoundaryErrors>> {
    same_shape("the predicted boundary map", predicted.pixels.dim(), truth.pixels.dim())?;
    let (forth, back) = (predicted.distances_to(truth), truth.distances_to(predicted));
    if back.is_empty() {
        return Ok(None);
    }
    let near: Vec<f64> = forth.iter().copied().filter(|d| *d < LIMIT).collect();
    let accuracy = if near.is_empty() { LIMIT } else { near.iter().sum::<f64>() / near.len() as f64 };
    let cut: f64 = forth.iter().chain(&back).map(|d| d.min(LIMIT)).sum();
    Ok(Some(BoundaryErrors { accuracy, completeness: cut / (forth.len() + back.len()) as f64 }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(at: usize) -> Edges {
        Edges::new(Array2::from_shape_fn((20, 30), |(_, x)| x == at))
    }

    proptest! {
        #[test]
        fn a_shifted_line_is_as_far_as_it_was_shifted(a in 0..30_usize, b in 0..30_usize) {
            let far = a.abs_diff(b) as f64;
            let errors = boundary_errors(&line(a), &line(b)).unwrap().unwrap();
            prop_assert_eq!(errors.accuracy, if far < LIMIT { far } else { LIMIT });
            prop_assert_eq!(errors.completeness, far.min(LIMIT));
        }

        #[test]
        fn no_error_is_beyond_the_limit_and_only_the_truth_has_none(
            bits in proptest::collection::vec((0..30_u8, 0..30_u8), 18 * 22)
        ) {
            let map = |of: fn(&(u8, u8)) -> bool| {
                Edges::new(Array2::from_shape_vec((18, 22), bits.iter().map(of).collect()).unwrap())
            };
            let (p, g) = (map(|b| b.0 == 0), map(|b| b.1 == 0));
            let Some(errors) = boundary_errors(&p, &g).unwrap() else { return Ok(()) };
            prop_assert!((0.0..=LIMIT).contains(&errors.accuracy) && (0.0..=LIMIT).contains(&errors.completeness));
            prop_assert_eq!(errors.completeness == 0.0, p == g);
            let back = boundary_errors(&g, &p).unwrap();
            // Completeness looks both ways alike; only the order of the sum differs.
            prop_assert!(back.is_none_or(|back| (back.completeness - errors.completeness).abs() < 1e-12));
            let own = boundary_errors(&g, &g).unwrap().unwrap();
            prop_assert_eq!((own.accuracy, own.completeness), (0.0, 0.0));
        }
    }

    #[test]
    fn nothing_predicted_is_the_limit_and_nothing_true_is_nothing() {
        let none = Edges::new(Array2::from_elem((20, 30), false));
        let errors = boundary_errors(&none, &line(3)).unwrap().unwrap();
        assert_eq!((errors.accuracy, errors.completeness), (LIMIT, LIMIT));
        assert!(boundary_errors(&line(3), &none).unwrap().is_none());
        assert!(boundary_errors(&line(3), &Edges::new(Array2::from_elem((2, 2), true))).is_err());
    }
}
