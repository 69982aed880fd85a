//! Scale-invariant boundary F1.

use crate::raster::{Map, Mask, same_shape};
use crate::{Error, Result};

/// Smallest depth that is inverted, as in the published code.
const MIN_DEPTH: f32 = 1e-6;
/// How many ratios are tried, and between which bounds: \\(t_k\\), \\(k = 1 \dots 10\\), from 1.05 to 1.25.
const RATIOS: usize = 10;

/// Boundary F1 of Depth Pro (Bochkovskii et al., 2024; `SI_boundary_F1`), with a mask.
///
/// On inverse depth \\(c = 1 / \max(d, 10^{-6})\\), a pixel and its neighbour in one of four directions make a boundary where
/// \\(c_i / c_j > t\\). Precision and recall are means over the four directions of hits over predicted (true) boundaries, and
///
/// \\[ F = \sum_k w_k \frac{2 P_k R_k}{P_k + R_k},\qquad w_k = \frac{t_k}{\sum_l t_l},\qquad
///     t_k = 1.05 + 0.2\\,\tfrac{k-1}{9} \\]
///
/// A term is 0 where \\(P_k + R_k = 0\\). A pair counts only where both pixels are in the mask. Blind to a scale of
/// either side, so it needs no alignment; both maps are `[height, width]`.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ, [`Error::Empty`] for an empty mask.
pub fn boundary_f1(prediction: Map<'_>, truth: Map<'_>, mask: Mask<'_>) -> Result<f64> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    same_shape("the mask", mask.dim(), truth.dim())?;
    if !mask.iter().any(|&keep| keep) {
        return Err(Error::Empty("the boundary F1"));
    }
    let thresholds: [f64; RATIOS] =
        std::array::from_fn(|k| 1.05 + (1.25 - 1.05) * k as f64 / (RATIOS - 1) as f64);
    // Boundaries above each ratio, by direction.
    let [mut predicted, mut known, mut hits] = [[[0_u64; RATIOS]; 4]; 3];
    let counts = |at| mask.get(at).is_some_and(|keep| *keep);
    for (y, x) in ndarray::indices(mask.dim()) {
        let (at, right, below) = ((y, x), (y, x + 1), (y + 1, x));
        let directions = [(right, at), (at, right), (below, at), (at, below)];
        for (direction, (behind, front)) in directions.into_iter().enumerate() {
            if !(counts(behind) && counts(front)) {
                continue;
            }
            // How many of the thresholds the ratio of inverse depths exceeds.
            let [of_prediction, of_truth] = [prediction, truth].map(|map| {
                let ratio = f64::from(map[behind].max(MIN_DEPTH)) / f64::from(map[front].max(MIN_DEPTH));
                thresholds.iter().take_while(|&&t| ratio > t).count()
            });
            predicted[direction][..of_prediction].iter_mut().for_each(|count| *count += 1);
            known[direction][..of_truth].iter_mut().for_each(|count| *count += 1);
            hits[direction][..of_prediction.min(of_truth)].iter_mut().for_each(|count| *count += 1);
        }
    }
    let total: f64 = thresholds.iter().sum();
    let score = |k: usize| {
        let share = |of: &[[u64; RATIOS]; 4]| {
            let shares = hits.iter().zip(of).map(|(hits, of)| hits[k] as f64 / of[k].max(1) as f64);
            0.25 * shares.sum::<f64>()
        };
        super::edges::harmonic(share(&predicted), share(&known))
    };
    Ok(thresholds.iter().enumerate().map(|(k, t)| t / total * score(k)).sum())
}
