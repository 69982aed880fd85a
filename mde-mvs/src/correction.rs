//! The smooth part of a prior's error, interpolated from residuals at matches.
//!
//! A monocular prior is right in its details and wrong by something smooth, that changes from one object to the next.
//! Residuals \\( r \\) (matches minus prior, in log depth) with weights \\( w \\) are averaged by an edge-aware kernel
//! \\( F \\) (the domain transform's recursive filter, Gastal and Oliveira, 2011), coarse to fine, each level shrunk to
//! the one before where few matches lie:
//!
//! \\[ u_{l+1} = u_l + \frac{F_l[w (r - u_l)]}{F_l[w] + \lambda} , \qquad
//!    s_{l+1}^2 = \frac{F_l[w (r - u_l)^2] + \lambda s_l^2}{F_l[w] + \lambda} . \\]
//!
//! The variance is about the level before: matches of neighbouring pixels share their errors, so that what is left after
//! the finest level hardly shows them.

use ndarray::{Array2, ArrayView2, Zip};

/// Widths of the kernel, as shares of the image's longer side.
const WIDTHS: [f32; 3] = [0.5, 0.16, 0.05];
/// Share of the kernel that matches must cover to count as much as the level before.
const SHRINK: f32 = 0.05;
/// Passes of the filter per level.
const PASSES: i32 = 2;
/// Rounds of reweighting.
const ROUNDS: usize = 3;

/// Differences of the guide between neighbours, as kernel distance.
pub(crate) struct Guide {
    /// Between a pixel and the one to its left.
    across: Array2<f32>,
    /// Between a pixel and the one above it.
    down: Array2<f32>,
}

impl Guide {
    /// From luma and log depth, in units of their own edges.
    pub(crate) fn new(luma: ArrayView2<'_, f32>, log_depth: ArrayView2<'_, f32>, edges: [f32; 2]) -> Self {
        let difference = |a: (usize, usize), b: (usize, usize)| {
            (luma[a] - luma[b]).abs() / edges[0] + (log_depth[a] - log_depth[b]).abs() / edges[1]
        };
        let shape = luma.dim();
        Self {
            across: Array2::from_shape_fn(
                shape,
                |(y, x)| {
                    if x > 0 { difference((y, x), (y, x - 1)) } else { 0.0 }
                },
            ),
            down: Array2::from_shape_fn(
                shape,
                |(y, x)| {
                    if y > 0 { difference((y, x), (y - 1, x)) } else { 0.0 }
                },
            ),
        }
    }

    /// The recursive filter of `width` pixels over each map.
    pub(crate) fn filter<const N: usize>(&self, maps: &mut [Array2<f32>; N], width: f32) {
        for pass in 0..PASSES {
            // Widths of the passes whose variances sum to that of the whole.
            let total = (4_f32.powi(PASSES) - 1.0).sqrt();
            let sigma = width * 3_f32.sqrt() * 2_f32.powi(PASSES - 1 - pass) / total;
            let base = -(2_f32.sqrt()) / sigma.max(0.1);
            let feedback = |d: &Array2<f32>| d.mapv(|d| (base * (1.0 + width * d)).exp());
            let (across, down) = (feedback(&self.across), feedback(&self.down));
            for map in maps.iter_mut() {
                rows(map, &across);
                columns(map, &down);
            }
        }
    }
}

fn rows(map: &mut Array2<f32>, feedback: &Array2<f32>) {
    for (mut line, a) in map.outer_iter_mut().zip(feedback.outer_iter()) {
        for x in 1..line.len() {
            line[x] += a[x] * (line[x - 1] - line[x]);
        }
        for x in (1..line.len()).rev() {
            line[x - 1] += a[x] * (line[x] - line[x - 1]);
        }
    }
}

fn columns(map: &mut Array2<f32>, feedback: &Array2<f32>) {
    let height = map.nrows();
    for y in 1..height {
        let (above, mut here) = map.multi_slice_mut((ndarray::s![y - 1, ..], ndarray::s![y, ..]));
        Zip::from(&mut here).and(&above).and(feedback.row(y)).for_each(|h, &u, &a| *h += a * (u - *h));
    }
    for y in (1..height).rev() {
        let (mut above, here) = map.multi_slice_mut((ndarray::s![y - 1, ..], ndarray::s![y, ..]));
        Zip::from(&mut above).and(&here).and(feedback.row(y)).for_each(|u, &h, &a| *u += a * (h - *u));
    }
}

/// The smooth field through residuals, and the variance of residuals about it, `[height, width]`.
pub(crate) struct Correction {
    pub(crate) mean: Array2<f32>,
    pub(crate) variance: Array2<f32>,
}

/// `spread` is the standard deviation of the residuals before any correction.
pub(crate) fn correct(
    residual: &Array2<f32>,
    weight: &Array2<f32>,
    guide: &Guide,
    spread: f32,
) -> Correction {
    let shape = residual.dim();
    let side = shape.0.max(shape.1) as f32;
    let mut mean: Array2<f32> = Array2::zeros(shape);
    let mut variance: Array2<f32> = Array2::from_elem(shape, spread * spread);
    for _ in 0..ROUNDS {
        let mut robust = weight.clone();
        Zip::from(&mut robust).and(residual).and(&mean).and(&variance).for_each(|w, &r, &u, &s| {
            *w /= 1.0 + (r - u).powi(2) / s.max(1e-6);
        });
        mean.fill(0.0);
        variance.fill(spread * spread);
        for share in WIDTHS {
            let left = Zip::from(residual).and(&mean).map_collect(|&r, &u| r - u);
            let product = &robust * &left;
            let square = &product * &left;
            let mut maps = [product, square, robust.clone()];
            guide.filter(&mut maps, share * side);
            let [product, square, total] = maps;
            Zip::from(&mut mean).and(&product).and(&total).for_each(|u, &p, &t| *u += p / (t + SHRINK));
            Zip::from(&mut variance)
                .and(&square)
                .and(&total)
                .for_each(|s, &q, &t| *s = (q + SHRINK * *s) / (t + SHRINK));
        }
    }
    Correction { mean, variance }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step that the guide has too stays a step; a gap without matches is filled from its own side.
    #[test]
    fn a_correction_fills_gaps_and_keeps_to_its_side_of_an_edge() {
        let shape = (40, 60);
        let luma = Array2::from_shape_fn(shape, |(_, x)| if x < 30 { 0.2 } else { 0.8 });
        let flat = Array2::zeros(shape);
        let guide = Guide::new(luma.view(), flat.view(), [0.1, 0.1]);
        let truth = luma.mapv(|l| if l < 0.5 { 0.3 } else { -0.1 });
        let weight = Array2::from_shape_fn(shape, |(y, x)| {
            if (10..30).contains(&y) && (20..40).contains(&x) { 0.0 } else { 1.0 }
        });
        let found = correct(&truth, &weight, &guide, 0.2);
        for ((y, x), u) in found.mean.indexed_iter() {
            assert!((u - truth[(y, x)]).abs() < 0.05, "{y} {x} {u}");
        }
        assert!(found.variance[(5, 5)] < 0.1 * 0.04);
    }

    #[test]
    fn without_matches_nothing_is_corrected() {
        let flat = Array2::zeros((8, 8));
        let guide = Guide::new(flat.view(), flat.view(), [0.1, 0.1]);
        let found = correct(&Array2::from_elem((8, 8), 5.0), &flat, &guide, 0.3);
        assert!(found.mean.iter().all(|u| *u == 0.0));
        assert!(found.variance.iter().all(|v| (v - 0.09).abs() < 1e-6));
    }
}
