//! The smooth part of a prior's error, interpolated from residuals at matches.
//!
//! A monocular prior is right in its details and wrong by something smooth, that changes from one object to the next. Residuals \\( r \\)
//! (matches minus prior, in log depth) with weights \\( w \\) are averaged by an edge-aware kernel \\( F \\) (the domain transform's
//! recursive filter, Gastal and Oliveira, 2011), coarse to fine, each level shrunk to the one before where few matches lie:
//!
//! \\[ u_{l+1} = u_l + \frac{F_l[w (r - u_l)]}{F_l[w] + \lambda} , \qquad
//!    s_{l+1}^2 = \frac{F_l[w (r - u_l)^2] + \lambda s_l^2}{F_l[w] + \lambda} . \\]
//!
//! The variance is about the level before: matches of neighbouring pixels share their errors, so that what is left after
//! the finest level hardly shows them.

use ndarray::{Array2, Zip};

use crate::raster::recursive_filter;

/// Widths of the kernel, as shares of the image's longer side.
const WIDTHS: [f32; 3] = [0.5, 0.16, 0.05];
/// Difference of luma, and of log depth, at which a correction stops.
const EDGE: f32 = 0.1;
/// Share of the kernel that matches must cover to count as much as the level before.
const SHRINK: f32 = 0.05;
/// Passes of the filter per level.
const PASSES: i32 = 2;
/// Rounds of reweighting.
const ROUNDS: usize = 3;

/// Kernel distances of each pixel from the one to its left and from the one above it, in units of [`EDGE`].
fn distances(luma: &Array2<f32>, log_depth: &Array2<f32>) -> [Array2<f32>; 2] {
    let apart = |map: &Array2<f32>, a: (usize, usize), b| (map[a] - map[b]).abs() / EDGE;
    let difference = |a, b| apart(luma, a, b) + apart(log_depth, a, b);
    // At the left and upper rim a pixel is compared with itself.
    let across = |(y, x): (usize, usize)| difference((y, x), (y, x.saturating_sub(1)));
    let down = |(y, x): (usize, usize)| difference((y, x), (y.saturating_sub(1), x));
    [Array2::from_shape_fn(luma.dim(), across), Array2::from_shape_fn(luma.dim(), down)]
}

/// What the recursive filter of `width` pixels keeps of the neighbour, across and down, for each of its passes.
fn feedback(distances: &[Array2<f32>; 2], width: f32) -> Vec<[Array2<f32>; 2]> {
    let pass = |pass: i32| {
        // Widths of the passes whose variances sum to that of the whole.
        let total = (4_f32.powi(PASSES) - 1.0).sqrt();
        let sigma = width * 3_f32.sqrt() * 2_f32.powi(PASSES - 1 - pass) / total;
        let base = -(2_f32.sqrt()) / sigma.max(0.1);
        distances.each_ref().map(|d| d.mapv(|d| (base * (1.0 + width * d)).exp()))
    };
    (0..PASSES).map(pass).collect()
}

/// The smooth field through residuals, and the variance of residuals about it, `[height, width]`.
pub(crate) struct Correction {
    pub(crate) mean: Array2<f32>,
    pub(crate) variance: Array2<f32>,
}

/// Corrections stop at edges of luma and log depth; `spread` is the standard deviation of the residuals before any correction.
pub(crate) fn correct(
    residual: &Array2<f32>,
    weight: &Array2<f32>,
    [luma, log_depth]: [&Array2<f32>; 2],
    spread: f32,
) -> Correction {
    let shape = residual.dim();
    let side = shape.0.max(shape.1) as f32;
    let distances = distances(luma, log_depth);
    let mut mean: Array2<f32> = Array2::zeros(shape);
    let mut variance: Array2<f32> = Array2::from_elem(shape, spread * spread);
    let levels = WIDTHS.map(|share| feedback(&distances, share * side));
    for _ in 0..ROUNDS {
        let mut robust = weight.clone();
        Zip::from(&mut robust).and(residual).and(&mean).and(&variance).for_each(|w, &r, &u, &s| {
            *w /= 1.0 + (r - u).powi(2) / s.max(1e-6);
        });
        mean.fill(0.0);
        variance.fill(spread * spread);
        for passes in &levels {
            let mut maps = Zip::from(residual).and(&mean).and(&robust).map_collect(|&r, &u, &w| {
                let left = r - u;
                [w * left, w * left * left, w, 0.0]
            });
            passes.iter().for_each(|pass| recursive_filter(&mut maps, pass));
            Zip::from(&mut mean).and(&mut variance).and(&maps).for_each(
                |u, s, &[product, square, total, _]| {
                    *u += product / (total + SHRINK);
                    *s = (square + SHRINK * *s) / (total + SHRINK);
                },
            );
        }
    }
    Correction { mean, variance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::s;

    /// A step that the guide has too stays a step; a gap without matches is filled from its own side.
    #[test]
    fn a_correction_fills_gaps_and_keeps_to_its_side_of_an_edge() {
        let shape = (40, 60);
        let luma = Array2::from_shape_fn(shape, |(_, x)| if x < 30 { 0.2 } else { 0.8 });
        let flat = Array2::zeros(shape);
        let truth = luma.mapv(|l| if l < 0.5 { 0.3 } else { -0.1 });
        let mut weight = Array2::ones(shape);
        weight.slice_mut(s![10..30, 20..40]).fill(0.0);
        let found = correct(&truth, &weight, [&luma, &flat], 0.2);
        for ((y, x), u) in found.mean.indexed_iter() {
            assert!((u - truth[(y, x)]).abs() < 0.05, "{y} {x} {u}");
        }
        assert!(found.variance[(5, 5)] < 0.1 * 0.04);
    }

    #[test]
    fn without_matches_nothing_is_corrected() {
        let flat = Array2::zeros((8, 8));
        let found = correct(&Array2::from_elem((8, 8), 5.0), &flat, [&flat, &flat], 0.3);
        assert!(found.mean.iter().all(|u| *u == 0.0));
        assert!(found.variance.iter().all(|v| (v - 0.09).abs() < 1e-6));
    }
}
