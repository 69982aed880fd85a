//! Windows beside a depth edge, moved onto the surface of their pixel.
//!
//! A window that reaches over an occlusion edge has the depth of the surface with more contrast, mostly the foreground's. Near a jump of
//! the depth that was found first, the window within reach whose colours are most like the pixel's takes its place, with its costs at the
//! same depth. [`own_contrast`] tells such a depth from one that the pixel's surface gives itself.

use mde_warp::PosedView;
use ndarray::Array2;
use rayon::prelude::*;
use std::array::from_fn;

use super::cost::{NOISE, RADIUS, Volume, WINDOW, WORST};
use super::patches;
use crate::raster::luma;

/// Difference of log depth between neighbours that is an edge.
const JUMP: f32 = 0.05;
/// Pixels from an edge within which windows are moved: those that touch it, and one for the edge's own error.
const BAND: usize = RADIUS + 1;
/// Standard deviation of the colours of one surface, sRGB.
const COLOUR: f32 = 0.06;
/// What a window at the distance of its radius has to be more alike.
const DISTANCE: f32 = 0.1;
const REACH: isize = RADIUS as isize;

/// A pixel, and the pixel whose window it takes.
pub(super) type Moved = (usize, usize);

/// How alike two colours are, 1 to 0: \\( (1 - d^2 / 8 \sigma^2)_+^4 \\), a Gaussian of compact support.
pub(super) fn alike(a: [f32; 3], b: [f32; 3], sigma: f32) -> f32 {
    let squared: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (1.0 - squared / (8.0 * sigma * sigma)).max(0.0).powi(4)
}

/// The colour of a pixel.
pub(super) fn colour(view: &PosedView, y: usize, x: usize) -> [f32; 3] {
    from_fn(|channel| view.image[(y, x, channel)])
}

/// Share of the contrast that a match at each pixel has from its own surface, 0 to 1: \\( v / (v + 4 \nu^2) \\), of the variance
/// \\( v \\) of the luma of those in its window that have its colour, and the noise \\( \nu \\).
pub(super) fn own_contrast(view: &PosedView) -> Array2<f32> {
    let luma = luma(view.image.view());
    let (height, width) = luma.dim();
    let around = |at: usize, most: usize| at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(most);
    Array2::from_shape_fn(luma.dim(), |(y, x)| {
        let here = colour(view, y, x);
        let window = around(y, height).flat_map(|row| around(x, width).map(move |column| (row, column)));
        let [weight, sum, squares] = window.fold([0.0; 3], |[weight, sum, squares], at| {
            let (like, luma) = (alike(here, colour(view, at.0, at.1), patches::COLOUR), luma[at]);
            [weight + like, sum + like * luma, squares + like * luma * luma]
        });
        let variance = (squares / weight - (sum / weight).powi(2)).max(0.0);
        variance / (variance + 4.0 * NOISE * NOISE)
    })
}

/// The windows to be moved, by the logarithms of the depth, row after row.
pub(super) fn moved(view: &PosedView, log_depth: &[f32]) -> Vec<Moved> {
    let (height, width) = view.camera.dim();
    let near = near_edges(log_depth, width);
    let pixels = near.into_par_iter().enumerate().filter(|(_, near)| *near);
    let moved = pixels.filter_map(|(pixel, _)| {
        let from = most_alike(view, [height, width], [pixel / width, pixel % width]);
        (from != pixel).then_some((pixel, from))
    });
    moved.collect()
}

/// Pixels within [`BAND`] of a jump.
fn near_edges(log_depth: &[f32], width: usize) -> Vec<bool> {
    let height = log_depth.len() / width;
    let mut near = vec![false; log_depth.len()];
    for (pixel, log) in log_depth.iter().enumerate() {
        let (y, x) = (pixel / width, pixel % width);
        let jump = |other: usize| (log_depth[other] - log).abs() > JUMP;
        if (x + 1 < width && jump(pixel + 1)) || (y + 1 < height && jump(pixel + width)) {
            for row in y.saturating_sub(BAND)..(y + BAND + 1).min(height) {
                near[row * width..][x.saturating_sub(BAND)..(x + BAND + 1).min(width)].fill(true);
            }
        }
    }
    near
}

/// The pixel within the radius whose window has the colours most like those at `[y, x]`.
fn most_alike(view: &PosedView, [height, width]: [usize; 2], [y, x]: [usize; 2]) -> usize {
    const SIDE: usize = WINDOW + 2 * RADIUS;
    let here = colour(view, y, x);
    let at = |dy: isize, dx: isize| {
        let (row, column) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        (row < height && column < width).then_some((row, column))
    };
    // Of all pixels that any of the windows has, and whether there is one: nothing beyond the image.
    let mut like = [[[0.0_f32; 2]; SIDE]; SIDE];
    for (dy, line) in (-2 * REACH..).zip(&mut like) {
        for (dx, like) in (-2 * REACH..).zip(line) {
            let Some((row, column)) = at(dy, dx) else { continue };
            *like = [alike(here, colour(view, row, column), COLOUR), 1.0];
        }
    }
    let add = |[a, b]: [f32; 2], [c, d]: &[f32; 2]| [a + c, b + d];
    let total = |part: &[[f32; 2]]| part.iter().fold([0.0; 2], add);
    let across = like.map(|line| from_fn::<_, WINDOW, _>(|left| total(&line[left..left + WINDOW])));
    let window = |dy: isize, dx: isize| {
        let (top, left) = ((dy + REACH) as usize, (dx + REACH) as usize);
        let lines = across[top..top + WINDOW].iter().map(|line| &line[left]);
        let [sum, count] = lines.fold([0.0; 2], add);
        sum / count - DISTANCE * ((dy * dy + dx * dx) as f32).sqrt() / RADIUS as f32
    };
    let mut best = (window(0, 0), y * width + x);
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let Some((row, column)) = at(dy, dx).filter(|&at| view.mask[at]) else { continue };
            let score = window(dy, dx);
            if score > best.0 {
                best = (score, row * width + column);
            }
        }
    }
    best.1
}

/// Gives the pixels the costs of the windows that they take, at their own depth: a surface is one of the even `multiples` of the inverse
/// depth at `centre`, and the same depth is another multiple there. A depth that is none of the surfaces there costs the most.
pub(super) fn take(volume: &mut Volume, moved: &[Moved], centre: &[f32], multiples: &[f32]) {
    let count = volume.surfaces;
    let (low, gap) = (multiples[0], (multiples[count - 1] - multiples[0]) / (count - 1) as f32);
    let costs = |&(pixel, from): &Moved| {
        let there = &volume.costs[from * count..(from + 1) * count];
        let ratio = centre[pixel] / centre[from];
        let at = |multiple: &f32| {
            let surface = ((multiple * ratio - low) / gap).round();
            // Surfaces are few enough for the cast; one below 0 or beyond the last is none.
            let known = (surface >= 0.0).then(|| there.get(surface as usize)).flatten();
            known.copied().unwrap_or(WORST as u8)
        };
        multiples.iter().map(at).collect::<Vec<u8>>()
    };
    let taken: Vec<Vec<u8>> = moved.par_iter().map(costs).collect();
    for ((pixel, _), costs) in moved.iter().zip(taken) {
        volume.costs[pixel * count..(pixel + 1) * count].copy_from_slice(&costs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};

    /// Stripes to the left of a plain surface, also of the windows that reach over both.
    #[test]
    fn a_plain_surface_has_no_contrast_of_its_own() {
        let (mut views, _) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (20, 30), &[[0.0; 3]]);
        for ((_, x, _), value) in views[0].image.indexed_iter_mut() {
            *value = if x < 15 { 0.2 + 0.06 * (x % 2) as f32 } else { 0.7 };
        }
        for ((_, x), own) in own_contrast(&views[0]).indexed_iter() {
            assert!(if x < 15 { *own > 0.5 } else { *own < 1e-3 }, "{x} {own}");
        }
    }

    /// Beside a step of depth and colour, windows keep to the side of their pixel; away from it none moves.
    #[test]
    fn windows_keep_to_the_side_of_their_pixel() {
        let (mut views, _) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (20, 30), &[[0.0; 3]]);
        let mut view = views.remove(0);
        for ((_, x, _), value) in view.image.indexed_iter_mut() {
            *value = if x < 15 { 0.2 } else { 0.7 };
        }
        let logs: Vec<f32> = (0..20 * 30).map(|i| if i % 30 < 15 { 0.0 } else { 0.7 }).collect();
        let found = moved(&view, &logs);
        assert!(!found.is_empty());
        for (pixel, from) in found {
            let (x, u) = (pixel % 30, from % 30);
            assert_eq!(x < 15, u < 15, "{x} takes the window of {u}");
            let apart = u.abs_diff(15).min((u + 1).abs_diff(15));
            assert!(apart >= RADIUS, "the window of {u} still reaches over the edge");
        }
        assert!(moved(&view, &[0.3; 20 * 30]).is_empty());
    }

    /// The window of a neighbour at half the inverse depth: its surface of twice the multiple has the pixel's depth.
    #[test]
    fn costs_are_taken_at_the_same_depth() {
        let multiples = [1.0, 1.5, 2.0, 2.5, 3.0];
        let costs = [[10; 5], [1, 2, 3, 4, 5]].concat();
        let mut volume = Volume { costs, surfaces: 5, seen: Array2::from_elem((1, 2), true) };
        take(&mut volume, &[(0, 1)], &[0.5, 0.25], &multiples);
        assert_eq!(volume.costs[..5], [3, 5, 254, 254, 254]);
        assert_eq!(volume.costs[5..], [1, 2, 3, 4, 5]);
    }
}
