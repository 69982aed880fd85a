//! Depth between confirmed matches.

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, Zip};
use rayon::prelude::*;

use super::Agreement;
use super::chance::TRUSTED;
use super::fuse::Fused;
use crate::Result;
use crate::sweep::edge::{alike, colour};

/// Share of the longer side within which matches are looked for.
const REACH: f32 = 8.0 / 320.0;
/// Share of the longer side between those that are tried.
const STRIDE: f32 = 2.0 / 320.0;
/// Standard deviation of the colours of one surface, sRGB.
const COLOUR: f32 = 0.04;
/// Slope of log depth per pixel at which a match counts half: a ramp between two surfaces is neither.
const RAMP: f32 = 0.02;
/// Least standard deviation of a filled log depth.
const LEAST: f32 = 0.02;
/// Matches, by weight, with which the variance is twice that of many.
const FEW: f32 = 6.0;

/// Where no other photograph confirms the depth, the weighted median of confirmed neighbours of like colour, mixed by precision with what was
/// there. The variance of the median is the square of half its range from 16 to 84 %, of the distance over the longer side, and of
/// [`LEAST`].
pub(super) fn fill(view: &PosedView, map: &mut Fused, agreement: &Agreement) -> Result<()> {
    let (height, width) = map.depth.dim();
    let longer = height.max(width) as f32;
    let reach = ((REACH * longer).round() as usize).max(2);
    let stride = ((STRIDE * longer).round() as usize).max(1);
    let mean = map.depth.mean().mapv(|z| if z > 0.0 { z.ln() } else { f32::NAN });
    let trust = Zip::indexed(&map.inlier).and(&agreement.agree).and(&mean).map_collect(
        |at, &inlier, &agree, &log| match inlier > TRUSTED && agree > 0 && log.is_finite() {
            true => inlier / (1.0 + (slope(&mean, at) / RAMP).powi(2)),
            false => 0.0,
        },
    );
    let confirmed = |at: (usize, usize)| trust[at] > TRUSTED;
    let wanted = mean.indexed_iter().filter(|(at, log)| log.is_finite() && !confirmed(*at));
    let wanted: Vec<(usize, usize)> = wanted.map(|(at, _)| at).collect();
    let filled = |&(y, x): &(usize, usize)| {
        let here = colour(view, y, x);
        let (mut matches, mut distance) = (Vec::new(), 0.0_f32);
        // The lattice is the image's, so that neighbours have the same matches.
        let along = |at: usize, side: usize| {
            (at.saturating_sub(reach).next_multiple_of(stride)..(at + reach + 1).min(side)).step_by(stride)
        };
        for row in along(y, height) {
            for column in along(x, width) {
                let trust = trust[(row, column)];
                if trust <= 0.0 {
                    continue;
                }
                let squared = (row.abs_diff(y).pow(2) + column.abs_diff(x).pow(2)) as f32;
                let near = (-2.0 * squared / (reach * reach) as f32).exp();
                let weight = trust * near * alike(here, colour(view, row, column), COLOUR);
                if weight > 1e-5 {
                    distance += weight * squared.sqrt();
                    matches.push((mean[(row, column)], weight));
                }
            }
        }
        let total: f32 = matches.iter().map(|(_, weight)| weight).sum();
        if total < 1e-3 {
            return None;
        }
        matches.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let [low, middle, high] = [0.16, 0.5, 0.84].map(|share| weighted_quantile(&matches, share * total));
        let spread = 0.5 * (high - low);
        let variance = spread * spread + (distance / (total * longer)).powi(2) + LEAST * LEAST;
        let few = FEW / (total * (stride * stride) as f32);
        Some((middle, variance * (1.0 + few)))
    };
    let found: Vec<Option<(f32, f32)>> = wanted.par_iter().map(filled).collect();
    let (mut depth, mut variance) = map.depth.clone().into_parts();
    for (at, found) in wanted.into_iter().zip(found) {
        let Some((median, v)) = found else { continue };
        let own = (variance[at] / (depth[at] * depth[at])).max(1e-8);
        let share = own / (own + v);
        let apart = median - mean[at];
        let log = mean[at] + share * apart;
        let mixed = share * v + (1.0 - share) * own + share * (1.0 - share) * apart * apart;
        depth[at] = log.exp();
        variance[at] = mixed * depth[at] * depth[at];
        map.ambiguity[at] *= 1.0 - share;
    }
    map.depth = GaussianDepth::new(depth, variance)?;
    Ok(())
}

/// The larger slope of log depth along either axis, 0 at the rim.
fn slope(log: &Array2<f32>, (y, x): (usize, usize)) -> f32 {
    let (height, width) = log.dim();
    let inside = |at: usize, side: usize| at > 0 && at + 1 < side;
    let across = if inside(x, width) { 0.5 * (log[(y, x + 1)] - log[(y, x - 1)]).abs() } else { 0.0 };
    let down = if inside(y, height) { 0.5 * (log[(y + 1, x)] - log[(y - 1, x)]).abs() } else { 0.0 };
    across.max(down)
}

/// The value at which the weights of the sorted values reach `sum`.
fn weighted_quantile(sorted: &[(f32, f32)], sum: f32) -> f32 {
    let mut reached = 0.0;
    let found = sorted.iter().find(|(_, weight)| {
        reached += weight;
        reached >= sum
    });
    found.or(sorted.last()).map_or(f32::NAN, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};

    /// A step of colour and depth with a gap along it, filled by a ramp: each side gets its own surface back, and what was confirmed stays.
    #[test]
    fn a_gap_is_filled_from_its_own_side() {
        let mut view = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (24, 320), &[[0.0; 3]]).0.swap_remove(0);
        let shape = view.camera.dim();
        let (height, width) = shape;
        let edge = width / 2;
        for ((_, x, _), value) in view.image.indexed_iter_mut() {
            *value = if x < edge { 0.2 } else { 0.7 };
        }
        let truth = Array2::from_shape_fn(shape, |(_, x)| if x < edge { 1.0 } else { 2.0_f32 });
        let gap = |x: usize| x.abs_diff(edge) < 3;
        let depth = Array2::from_shape_fn(shape, |(y, x)| if gap(x) { 1.5 } else { truth[(y, x)] });
        let variance = Array2::from_shape_fn(shape, |(_, x)| if gap(x) { 0.2 } else { 1e-4 });
        let confirmed = Array2::from_shape_fn(shape, |(_, x)| u8::from(!gap(x)));
        let mut map = Fused {
            depth: GaussianDepth::new(depth, variance).unwrap(),
            inlier: confirmed.mapv(f32::from),
            corrected: truth.clone(),
            ambiguity: Array2::ones(shape),
        };
        let agreement = Agreement { agree: confirmed, visible: Array2::ones(shape) };
        let before = map.depth.clone();
        fill(&view, &mut map, &agreement).unwrap();
        let y = height / 2;
        for x in 0..width {
            let (z, v) = map.depth.get(y, x).unwrap();
            if gap(x) {
                assert!((z / truth[(y, x)] - 1.0).abs() < 0.05, "{x}: {z}");
                assert!(v.sqrt() < 0.15 && map.ambiguity[(y, x)] < 0.1, "{x}: {v}");
            } else {
                // Beside the gap the slope of the ramp takes the confirmation.
                assert!(x.abs_diff(edge) < 5 || Some((z, v)) == before.get(y, x));
            }
        }
    }
}
