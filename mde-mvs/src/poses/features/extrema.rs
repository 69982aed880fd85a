//! Extrema of differences of Gaussians, and the directions of the gradient about them.

use super::scale_space::{FIRST_SIGMA, LAYERS, Octave, ScaleSpace, difference};
use nalgebra::{Matrix3, Vector3};
use ndarray::Array2;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Pixels at the rim of an octave where no extremum is looked for.
const RIM: usize = 5;
/// Steps of the refinement at most.
const STEPS: usize = 5;
/// Directions of the histogram of gradients.
const DIRECTIONS: usize = 36;
/// A further direction needs this share of the strongest.
const PEAK: f32 = 0.8;
/// Least contrast of an extremum, as OpenCV's `contrastThreshold`, of colours in \\( [0, 1] \\).
const CONTRAST: f64 = 0.02;
/// Largest ratio of the principal curvatures; edges exceed it.
const EDGE: f64 = 10.0;

/// A keypoint in the pixels of its octave.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremum {
    pub(super) octave: usize,
    pub(super) layer: usize,
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) sigma: f64,
    pub(super) angle: f64,
    pub(super) response: f64,
    cell: [usize; 2],
}

/// All extrema with each of their directions, in the order of the scan.
pub(super) fn find(space: &ScaleSpace) -> Vec<Extremum> {
    let mut all = Vec::new();
    for (index, octave) in space.octaves.iter().enumerate() {
        let (height, width) = octave[0].dim();
        if width <= 2 * RIM || height <= 2 * RIM {
            break;
        }
        let rows: Vec<(usize, usize)> =
            (1..=LAYERS).flat_map(|layer| (RIM..height - RIM).map(move |y| (layer, y))).collect();
        let of_row = |&(layer, y): &(usize, usize)| {
            let columns = candidates(octave, layer, y).into_iter();
            columns.filter_map(move |x| refine(octave, index, layer, x, y))
        };
        let mut found: Vec<Extremum> = rows.par_iter().flat_map_iter(of_row).collect();
        // Neighbouring starts can end at one extremum.
        found.sort_by_key(|e| (e.layer, e.cell));
        found.dedup_by_key(|e| (e.layer, e.cell));
        let oriented: Vec<Vec<Extremum>> = found.par_iter().map(|e| orient(octave, e)).collect();
        all.extend(oriented.into_iter().flatten());
    }
    all
}

/// Columns of a row that are above or below all of their 26 neighbours.
fn candidates(octave: &Octave, layer: usize, y: usize) -> Vec<usize> {
    let threshold = (0.5 * CONTRAST / LAYERS as f64) as f32;
    let [under, over] = [layer, layer + 1].map(|layer| octave[layer].row(y));
    (RIM..under.len() - RIM)
        .filter(|&x| {
            let value = over[x] - under[x];
            if value.abs() <= threshold {
                return false;
            }
            let all = |test: fn(f32, f32) -> bool| {
                let of =
                    |layer| move |y| (x - 1..=x + 1).all(|x| test(value, difference(octave, layer, (y, x))));
                (layer - 1..=layer + 1).all(|layer| (y - 1..=y + 1).all(of(layer)))
            };
            if value > 0.0 { all(|a, b| a >= b) } else { all(|a, b| a <= b) }
        })
        .collect()
}

/// The extremum of the quadratic through the neighbours; nothing where it is too weak or an edge.
fn refine(octave: &Octave, index: usize, mut layer: usize, mut x: usize, mut y: usize) -> Option<Extremum> {
    let (height, width) = octave[0].dim();
    for step in 0.. {
        let [below, here, above] = [layer - 1, layer, layer + 1];
        let d = |layer: usize, dx: isize, dy: isize| {
            f64::from(difference(octave, layer, (y.wrapping_add_signed(dy), x.wrapping_add_signed(dx))))
        };
        let value = d(here, 0, 0);
        let [x1, y1] = [d(here, 1, 0) - d(here, -1, 0), d(here, 0, 1) - d(here, 0, -1)];
        let gradient = 0.5 * Vector3::new(x1, y1, d(above, 0, 0) - d(below, 0, 0));
        let xx = d(here, 1, 0) + d(here, -1, 0) - 2.0 * value;
        let yy = d(here, 0, 1) + d(here, 0, -1) - 2.0 * value;
        let ss = d(above, 0, 0) + d(below, 0, 0) - 2.0 * value;
        let xy = 0.25 * (d(here, 1, 1) - d(here, -1, 1) - d(here, 1, -1) + d(here, -1, -1));
        let xs = 0.25 * (d(above, 1, 0) - d(above, -1, 0) - d(below, 1, 0) + d(below, -1, 0));
        let ys = 0.25 * (d(above, 0, 1) - d(above, 0, -1) - d(below, 0, 1) + d(below, 0, -1));
        let offset = -Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss).lu().solve(&gradient)?;
        if offset.iter().all(|o| o.abs() < 0.5) {
            let response = (value + 0.5 * gradient.dot(&offset)).abs();
            let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
            let keep = response * LAYERS as f64 >= CONTRAST
                && determinant > 0.0
                && trace * trace * EDGE < (EDGE + 1.0).powi(2) * determinant;
            let sigma = FIRST_SIGMA * 2f64.powf((layer as f64 + offset.z) / LAYERS as f64);
            return keep.then_some(Extremum {
                octave: index,
                layer,
                x: x as f64 + offset.x,
                y: y as f64 + offset.y,
                sigma,
                angle: 0.0,
                response,
                cell: [y, x],
            });
        }
        if step + 1 == STEPS || offset.iter().any(|o| o.is_nan() || o.abs() > width.max(height) as f64) {
            return None;
        }
        let moved = |at: usize, by: f64| at.checked_add_signed(by.round() as isize);
        (x, y, layer) = (moved(x, offset.x)?, moved(y, offset.y)?, moved(layer, offset.z)?);
        let inside = (RIM..width - RIM).contains(&x) && (RIM..height - RIM).contains(&y);
        if !inside || !(1..=LAYERS).contains(&layer) {
            return None;
        }
    }
    None
}

/// Gradient of a Gaussian at a pixel that is not on the rim: twice the central difference.
pub(super) fn gradient(plane: &Array2<f32>, x: usize, y: usize) -> (f32, f32) {
    (plane[(y, x + 1)] - plane[(y, x - 1)], plane[(y + 1, x)] - plane[(y - 1, x)])
}

/// The extremum once for each strong direction of the gradient about it.
fn orient(octave: &Octave, extremum: &Extremum) -> Vec<Extremum> {
    let plane = &octave[extremum.layer];
    let radius = (4.5 * extremum.sigma).round() as usize;
    let fall = (-0.5 / (1.5 * extremum.sigma).powi(2)) as f32;
    let [row, column] = extremum.cell;
    let span = |at: usize, size: usize| at.saturating_sub(radius).max(1)..=(at + radius).min(size - 2);

    let mut raw = [0f32; DIRECTIONS];
    for y in span(row, plane.nrows()) {
        for x in span(column, plane.ncols()) {
            let (dx, dy) = gradient(plane, x, y);
            let squared = (x.abs_diff(column).pow(2) + y.abs_diff(row).pow(2)) as f32;
            let turn = super::descriptor::turns(dy, dx) * DIRECTIONS as f32;
            let bin = (turn + 0.5) as usize % DIRECTIONS;
            raw[bin] += (squared * fall).exp() * dx.hypot(dy);
        }
    }
    let at = |histogram: &[f32; DIRECTIONS], i: isize| histogram[i.rem_euclid(DIRECTIONS as isize) as usize];
    let smooth: [f32; DIRECTIONS] = std::array::from_fn(|i| {
        let i = i as isize;
        (at(&raw, i - 2) + at(&raw, i + 2)) / 16.0
            + (at(&raw, i - 1) + at(&raw, i + 1)) * (4.0 / 16.0)
            + at(&raw, i) * (6.0 / 16.0)
    });
    let strongest = smooth.iter().copied().fold(0.0, f32::max);
    (0..DIRECTIONS as isize)
        .filter_map(|i| {
            let [left, here, right] = [i - 1, i, i + 1].map(|i| at(&smooth, i));
            let peak = here > left && here > right && here >= PEAK * strongest;
            peak.then(|| {
                let offset = 0.5 * (left - right) / (left - 2.0 * here + right);
                let turn = (i as f64 + f64::from(offset)) / DIRECTIONS as f64;
                Extremum { angle: turn.rem_euclid(1.0) * TAU, ..*extremum }
            })
        })
        .collect()
}
