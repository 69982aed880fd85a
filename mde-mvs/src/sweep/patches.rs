//! The last step of a depth map: slanted patches, compared at fractions of a pixel.
//!
//! Sweeps compare windows on surfaces of one shape, and a field blurs over its samples. Here each pixel has a plane of its own, linear in
//! inverse depth, \\( w(u, v) = w + g_x (u - x) + g_y (v - y) \\), as in PatchMatch stereo (Bleyer et al., 2011) and COLMAP (Schönberger
//! et al., 2016). Pixels try the planes of their neighbours and small changes of their own, in two colours of a checkerboard.

use mde_uncertainty::random::CounterRng;
use mde_warp::PosedView;
use mde_warp::transfer::Transfer;
use nalgebra::{Matrix3, Vector3};
use ndarray::{Array2, ArrayView2};
use rand::RngExt;
use rayon::prelude::*;
use std::array::from_fn;

use super::cost::NOISE;
use super::edge::{alike, colour};
use crate::raster::luma;
use crate::{Error, Result};

/// Half the side of a patch, pixels, and pixels between its samples.
const RADIUS: usize = 5;
const STEP: usize = 2;
/// Samples of a patch, and those whose sums are taken side by side.
const SAMPLES: usize = (2 * RADIUS / STEP + 1) * (2 * RADIUS / STEP + 1);
const LANES: usize = 4;
/// Standard deviation of the weight of a sample by colour (sRGB), and by distance in pixels.
pub(super) const COLOUR: f32 = 0.1;
const DISTANCE: f32 = 0.75 * RADIUS as f32;
/// Photographs that a patch is compared with at most.
const SOURCES: usize = 8;
/// Cost of a point that does not return to its pixel from the other photograph's depth, and the distance in pixels that is the most.
const GEOMETRY: f32 = 0.5;
const RETURN: f32 = 2.0;
/// Cost of a plane that differs from those of its neighbours, and the relative difference that is the most.
const ROUGHNESS: f32 = 0.1;
const STEP_OF_DEPTH: f32 = 0.02;
/// Cost of a move of the depth by [`RANGE`].
const MOVE: f32 = 0.003;
/// Depths move by less than this; what is further off is another surface, which patches find no better than the sweeps.
const RANGE: f32 = 0.03;
/// How much worse a plane may return, of at most 1, and still be taken.
const RETURN_SLACK: f32 = 0.05;
/// A point nearer than this is behind a camera.
const NEAR: f32 = 1e-6;
/// Half the side of the square of pixels that a first plane is fitted to, and the relative residual of half its weight.
const FIT: usize = 3;
const RESIDUAL: f32 = 0.02;
/// Changes of inverse depth and of its relative slope per pixel that the first iteration tries at most; each later one half of them.
const CHANGE: f32 = 0.02;
const CHANGE_OF_SLOPE: f32 = 0.004;
const ITERATIONS: u64 = 3;
/// Relative difference of planes that are the same.
const SAME: f32 = 1e-3;

/// Inverse depth about a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Plane {
    w: f32,
    slope: [f32; 2],
}

impl Plane {
    /// The same plane about the pixel that lies `[dx, dy]` away.
    fn moved(self, [dx, dy]: [isize; 2]) -> Self {
        Self { w: self.w + self.slope[0] * dx as f32 + self.slope[1] * dy as f32, ..self }
    }
}

/// The plane of a pixel, its cost of colour and return, and the return alone.
#[derive(Debug, Clone, Copy, Default)]
struct Match {
    plane: Plane,
    cost: f32,
    back: f32,
    /// The photographs that all planes of the pixel are compared with, a bit each.
    with: u8,
}

/// Where another photograph shows a plane's pixel, the inverse of its homogeneous depth, and the distance of its return, at most 1.
#[derive(Debug, Clone, Copy, Default)]
struct Shown {
    pixel: [f32; 2],
    scale: f32,
    back: f32,
}

/// Samples about a pixel of the reference: offsets, weights and luma. Those that are none have no weight.
struct Patch {
    x: [f32; SAMPLES],
    y: [f32; SAMPLES],
    weight: [f32; SAMPLES],
    luma: [f32; SAMPLES],
    /// Sum of the weights, weighted mean and variance of the luma.
    all: f32,
    mean: f32,
    variance: f32,
}

/// \\( A (u, v, 1)^\top + w t \\), as [`Transfer`] has it.
struct Projection {
    rotation: Matrix3<f32>,
    translation: Vector3<f32>,
}

impl Projection {
    fn new(from: &PosedView, to: &PosedView) -> Self {
        let Transfer { rotation, translation, .. } = Transfer::new(from, to);
        Self { rotation: rotation.cast(), translation: translation.cast() }
    }

    /// Homogeneous pixel.
    fn of(&self, [u, v]: [f32; 2], w: f32) -> [f32; 3] {
        (self.rotation * Vector3::new(u, v, 1.0) + self.translation * w).into()
    }

    fn pixel(&self, at: [f32; 2], w: f32) -> Option<[f32; 2]> {
        let [x, y, z] = self.of(at, w);
        (z > NEAR).then(|| [x / z, y / z])
    }
}

/// Another photograph: its luma, its depth, and the way there and back.
struct Source<'a> {
    view: &'a PosedView,
    /// Of each pixel \\( a, b, c, d \\), with which \\( a + b x + y (c + d x) \\) is the luma between it and the three beyond it.
    bilinear: Vec<[f32; 4]>,
    depth: ArrayView2<'a, f32>,
    there: Projection,
    back: Projection,
}

impl<'a> Source<'a> {
    fn new(view: &'a PosedView, depth: ArrayView2<'a, f32>, reference: &PosedView) -> Self {
        let luma = luma(view.image.view());
        let (height, width) = luma.dim();
        let between = |at: usize| {
            let (y, x) = (at / width, at % width);
            let corner = |dy: usize, dx: usize| luma[((y + dy).min(height - 1), (x + dx).min(width - 1))];
            let [a, right, below, across] = [corner(0, 0), corner(0, 1), corner(1, 0), corner(1, 1)];
            [a, right - a, below - a, across - right - below + a]
        };
        let bilinear = (0..height * width).map(between).collect();
        let (there, back) = (Projection::new(reference, view), Projection::new(view, reference));
        Self { view, bilinear, depth, there, back }
    }

    /// Where the plane of the pixel `at` lies there; nothing where the photograph does not show it.
    fn shown(&self, plane: Plane, at: [f32; 2]) -> Option<Shown> {
        let [most_x, most_y] = [self.view.camera.width - 1, self.view.camera.height - 1].map(|n| n as f32);
        let [x, y, z] = self.there.of(at, plane.w);
        if z <= NEAR {
            return None;
        }
        let scale = 1.0 / z;
        let pixel = [x * scale, y * scale];
        if !(pixel[0] >= 0.0 && pixel[1] >= 0.0 && pixel[0] < most_x && pixel[1] < most_y) {
            return None;
        }
        let nearest = ((pixel[1] + 0.5) as usize, (pixel[0] + 0.5) as usize);
        if !self.view.mask[nearest] {
            return None;
        }
        let z = self.depth[nearest];
        let returned = (z > 0.0).then(|| self.back.pixel(pixel, 1.0 / z)).flatten();
        let back = returned.map_or(1.0, |[u, v]| {
            let squared: f32 = (u - at[0]).powi(2) + (v - at[1]).powi(2);
            (squared.sqrt() / RETURN).min(1.0)
        });
        Some(Shown { pixel, scale, back })
    }

    /// \\( 1 - \mathrm{ZNCC} \\), 0 to 1, of a patch and what the plane has there.
    fn unlikeness(&self, plane: Plane, Shown { pixel, scale, .. }: Shown, patch: &Patch) -> f32 {
        // Derivative of the pixel there by that here, along the plane.
        let turn = |row: usize, axis: usize| {
            self.there.rotation[(row, axis)] + plane.slope[axis] * self.there.translation[row]
        };
        let along = |row: usize, axis: usize| (turn(row, axis) - pixel[row] * turn(2, axis)) * scale;
        let affine = [[along(0, 0), along(0, 1)], [along(1, 0), along(1, 1)]];
        let width = self.view.camera.width as u32;
        let [most_x, most_y] = [self.view.camera.width - 1, self.view.camera.height - 1].map(|n| n as f32);
        let (mut index, mut fx, mut fy) = ([0_u32; SAMPLES], [0.0_f32; SAMPLES], [0.0_f32; SAMPLES]);
        for i in 0..SAMPLES {
            let (dx, dy) = (patch.x[i], patch.y[i]);
            // In this order what is no number is within, too.
            let x = (pixel[0] + affine[0][0] * dx + affine[0][1] * dy).max(0.5).min(most_x);
            let y = (pixel[1] + affine[1][0] * dx + affine[1][1] * dy).max(0.5).min(most_y);
            let ((column, rest_x), (row, rest_y)) = (split(x), split(y));
            index[i] = row * width + column;
            (fx[i], fy[i]) = (rest_x, rest_y);
        }
        let mut there = [0.0_f32; SAMPLES];
        for first in (0..SAMPLES).step_by(LANES) {
            let corners: [[f32; 4]; LANES] = from_fn(|lane| self.bilinear[index[first + lane] as usize]);
            let [a, b, c, d] = from_fn(|part| from_fn::<_, LANES, _>(|lane| corners[lane][part]));
            for lane in 0..LANES {
                let (fx, fy) = (fx[first + lane], fy[first + lane]);
                there[first + lane] = a[lane] + fx * b[lane] + fy * (c[lane] + fx * d[lane]);
            }
        }
        // Weighted values, squares and products, summed in lanes, so that they need not wait for each other.
        let mut sums = [[0.0_f32; LANES]; 3];
        for first in (0..SAMPLES).step_by(LANES) {
            let of = |values: &[f32; SAMPLES]| -> [f32; LANES] { from_fn(|lane| values[first + lane]) };
            let (weight, there, here) = (of(&patch.weight), of(&there), of(&patch.luma));
            let weighted: [f32; LANES] = from_fn(|lane| weight[lane] * there[lane]);
            for lane in 0..LANES {
                sums[0][lane] += weighted[lane];
                sums[1][lane] += weighted[lane] * there[lane];
                sums[2][lane] += weighted[lane] * here[lane];
            }
        }
        let [mean, square, product] = sums.map(|lanes| lanes.iter().sum::<f32>() / patch.all);
        let variance = (square - mean * mean).max(0.0);
        let spread = (patch.variance + NOISE * NOISE) * (variance + NOISE * NOISE);
        (1.0 - (product - mean * patch.mean) / spread.sqrt()).clamp(0.0, 1.0)
    }
}

/// The whole part of a coordinate from .5 to 4 million and the rest, 0 to 1; a cast to an integer, which saturates, is not vectorised.
fn split(coordinate: f32) -> (u32, f32) {
    const WHOLE: f32 = (1 << 23) as f32;
    // Numbers of that size have no fraction: this rounds.
    let shifted = (coordinate - 0.5) + WHOLE;
    (shifted.to_bits() - WHOLE.to_bits(), coordinate - (shifted - WHOLE))
}

/// The reference with what its planes are judged by.
struct Reference<'a> {
    colours: Vec<[f32; 3]>,
    luma: Vec<f32>,
    /// Inverse depth before; 0 where unknown.
    before: Vec<f32>,
    sources: Vec<Source<'a>>,
    width: usize,
    height: usize,
}

impl<'a> Reference<'a> {
    fn new(views: &'a [PosedView], depths: &[ArrayView2<'a, f32>]) -> Self {
        let view = &views[0];
        let (height, width) = view.camera.dim();
        let others = views[1..].iter().zip(&depths[1..]).take(SOURCES);
        let others = others.map(|(other, depth)| Source::new(other, *depth, view));
        let inverse = |(&z, &real): (&f32, &bool)| if z > 0.0 && real { z.recip() } else { 0.0 };
        Self {
            colours: (0..height * width).map(|at| colour(view, at / width, at % width)).collect(),
            luma: luma(view.image.view()).into_iter().collect(),
            before: depths[0].iter().zip(&view.mask).map(inverse).collect(),
            sources: others.collect(),
            width,
            height,
        }
    }

    /// The pixel that lies `[dx, dy]` away, in the image.
    fn beside(&self, at: usize, [dx, dy]: [isize; 2]) -> Option<usize> {
        let (x, y) = ((at % self.width).checked_add_signed(dx)?, (at / self.width).checked_add_signed(dy)?);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }

    fn patch(&self, at: usize) -> Patch {
        let none = [0.0; SAMPLES];
        let mut patch =
            Patch { x: none, y: none, weight: none, luma: none, all: 0.0, mean: 0.0, variance: 0.0 };
        let reach = RADIUS as isize;
        let offsets = (-reach..=reach).step_by(STEP);
        let offsets = offsets.clone().flat_map(|dy| offsets.clone().map(move |dx| [dx, dy]));
        for (i, [dx, dy]) in offsets.enumerate() {
            let Some(sample) = self.beside(at, [dx, dy]) else { continue };
            let squared = (dx * dx + dy * dy) as f32;
            let near = (1.0 - squared / (8.0 * DISTANCE * DISTANCE)).max(0.0).powi(4);
            let weight = near * alike(self.colours[at], self.colours[sample], COLOUR);
            let luma = self.luma[sample];
            (patch.x[i], patch.y[i]) = (dx as f32, dy as f32);
            (patch.weight[i], patch.luma[i]) = (weight, luma);
            patch.all += weight;
            patch.mean += weight * luma;
            patch.variance += weight * luma * luma;
        }
        patch.mean /= patch.all;
        patch.variance = (patch.variance / patch.all - patch.mean * patch.mean).max(0.0);
        patch
    }

    fn pixel(&self, at: usize) -> [f32; 2] {
        [(at % self.width) as f32, (at / self.width) as f32]
    }

    /// The first plane of a pixel, by the better half of the photographs that show it.
    fn first(&self, at: usize) -> Match {
        let (plane, patch) = (self.fitted(at), self.patch(at));
        let costs = self.sources.iter().enumerate().filter_map(|(index, source)| {
            let shown = source.shown(plane, self.pixel(at))?;
            Some((source.unlikeness(plane, shown, &patch) + GEOMETRY * shown.back, shown.back, 1 << index))
        });
        let mut costs: Vec<(f32, f32, u8)> = costs.collect();
        costs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        costs.truncate(costs.len().div_ceil(2));
        if costs.is_empty() {
            return Match { plane, cost: 1.0 + GEOMETRY, back: 1.0, with: 0 };
        }
        let [cost, back] = costs.iter().fold([0.0; 2], |[cost, back], one| [cost + one.0, back + one.1]);
        let [cost, back] = [cost, back].map(|sum| sum / costs.len() as f32);
        Match { plane, cost, back, with: costs.iter().map(|one| one.2).sum() }
    }

    /// Another plane of a pixel by the same photographs; nothing where one does not show it, or its cost and `apart` are not below `least`.
    fn judge(
        &self,
        plane: Plane,
        at: usize,
        with: u8,
        patch: &Patch,
        [apart, least]: [f32; 2],
    ) -> Option<Match> {
        let photographs = || self.sources.iter().enumerate().filter(|(index, _)| with >> index & 1 == 1);
        let mut shown = [Shown::default(); SOURCES];
        for (index, source) in photographs() {
            shown[index] = source.shown(plane, self.pixel(at))?;
        }
        let count = with.count_ones() as f32;
        let back = shown.iter().map(|shown| shown.back).sum::<f32>() / count;
        // At least this, whatever the colours are.
        let mut cost = GEOMETRY * back;
        for (index, source) in photographs() {
            if cost + apart >= least {
                return None;
            }
            cost += source.unlikeness(plane, shown[index], patch) / count;
        }
        (cost + apart < least).then_some(Match { plane, cost, back, with })
    }

    /// The plane through the pixel's depth with the slope of its neighbours of like colour and depth.
    fn fitted(&self, at: usize) -> Plane {
        let w = self.before[at];
        if w <= 0.0 {
            return Plane::default();
        }
        let reach = FIT as isize;
        // Half a pixel squared of doubt keeps the slope of few neighbours small.
        let (mut xx, mut xy, mut yy, mut xw, mut yw) = (0.5, 0.0, 0.5, 0.0, 0.0);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let known = self.beside(at, [dx, dy]).filter(|&i| self.before[i] > 0.0);
                let Some(beside) = known else { continue };
                let change = self.before[beside] / w - 1.0;
                let like = alike(self.colours[at], self.colours[beside], COLOUR);
                let k = like / (1.0 + (change / RESIDUAL).powi(2));
                let (x, y) = (dx as f32, dy as f32);
                (xx, xy, yy) = (xx + k * x * x, xy + k * x * y, yy + k * y * y);
                (xw, yw) = (xw + k * x * change, yw + k * y * change);
            }
        }
        let determinant = xx * yy - xy * xy;
        let slope = [(yy * xw - xy * yw) / determinant, (xx * yw - xy * xw) / determinant];
        Plane { w, slope: slope.map(|s| w * s) }
    }

    /// A pixel's place among those of its colour.
    fn slot(&self, at: usize) -> usize {
        at / self.width * self.width.div_ceil(2) + at % self.width / 2
    }

    /// The pixel at a place among those of a colour, if its depth is known.
    fn known(&self, colour: usize, slot: usize) -> Option<usize> {
        let half = self.width.div_ceil(2);
        let (x, y) = (slot % half * 2 + (slot / half + colour) % 2, slot / half);
        let at = y * self.width + x;
        (x < self.width && self.before[at] > 0.0).then_some(at)
    }

    /// The pixel's inverse depth on the planes of its neighbours, which have the other colour, with the likeness of their colours.
    fn neighbours(&self, others: &[Match], at: usize) -> [[f32; 2]; 8] {
        SMOOTH.map(|offset| {
            let beside = self.beside(at, offset).map(|beside| (beside, others[self.slot(beside)].plane));
            let Some((beside, plane)) = beside.filter(|(_, plane)| plane.w > 0.0) else { return [0.0; 2] };
            let like = alike(self.colours[at], self.colours[beside], COLOUR) + 1e-3;
            [plane.moved(offset.map(|d| -d)).w, like]
        })
    }

    /// Cost of a plane before it is compared with photographs: its difference from the neighbours' and from the depth before.
    fn apart(&self, plane: Plane, at: usize, neighbours: &[[f32; 2]; 8]) -> f32 {
        let of = |[w, like]: &[f32; 2]| [like * ((w / plane.w - 1.0).abs() / STEP_OF_DEPTH).min(1.0), *like];
        let [rough, all] = neighbours.iter().map(of).fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        let far = (plane.w / self.before[at] - 1.0) / RANGE;
        ROUGHNESS * if all > 0.0 { rough / all } else { 0.0 } + MOVE * far * far
    }

    /// The best of a pixel's plane, those of its neighbours, and changes of the best.
    fn improved(&self, mut best: Match, others: &[Match], at: usize, iteration: u64) -> Match {
        if best.with == 0 {
            return best;
        }
        let (patch, neighbours) = (self.patch(at), self.neighbours(others, at));
        let mut least = best.cost + self.apart(best.plane, at, &neighbours);
        let mut attempt = |plane: Plane, best: &mut Match| {
            if !(plane.w > 0.0 && (plane.w / self.before[at] - 1.0).abs() < RANGE) {
                return;
            }
            let apart = self.apart(plane, at, &neighbours);
            if apart < least
                && let Some(found) = self.judge(plane, at, best.with, &patch, [apart, least])
            {
                (least, *best) = (found.cost + apart, found);
            }
        };
        // Those beside it and those further away take turns.
        let offsets = if iteration.is_multiple_of(2) { &BESIDE } else { &FAR };
        for &offset in offsets {
            let Some(beside) = self.beside(at, offset) else { continue };
            let plane = others[self.slot(beside)].plane.moved(offset.map(|d| -d));
            if (plane.w / best.plane.w - 1.0).abs() >= SAME {
                attempt(plane, &mut best);
            }
        }
        let mut random = CounterRng::new(0, "patches", iteration, at as u64);
        let shrunk = 0.5_f32.powi(iteration as i32);
        let step = CHANGE * shrunk * random.random_range(0.5..1.0);
        for factor in [1.0 + step, 1.0 - step] {
            let plane = Plane { w: best.plane.w * factor, ..best.plane };
            attempt(plane, &mut best);
        }
        let Plane { w, slope } = best.plane;
        let slope = slope.map(|s| s + w * CHANGE_OF_SLOPE * shrunk * random.random_range(-1.0..1.0));
        attempt(Plane { w, slope }, &mut best);
        best
    }
}

/// Neighbours whose planes are tried, in turns, and those whose planes a pixel's should continue, `[dx, dy]`: all of the other colour.
const BESIDE: [[isize; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];
const FAR: [[isize; 2]; 4] = [[-5, 0], [5, 0], [0, -5], [0, 5]];
const SMOOTH: [[isize; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-3, 0], [3, 0], [0, -3], [0, 3]];

/// The z-depth of `views[0]`, moved by less than 3 % where slanted patches match better there. `depths` are those of all views,
/// `[height, width]` each, in the unit of the poses, 0 where unknown; the first 8 others are compared.
///
/// The cost of a plane is the mean, over the half of the photographs that a pixel's first plane fits best, of \\( 1 - \mathrm{ZNCC} \\)
/// over a patch of 11 x 11 pixels weighted by colour and distance, plus half the distance there and back over 2 pixels, at most 1; and a
/// tenth of the relative difference from eight neighbours' planes over .02.
///
/// # Errors
/// [`Error::TooFewViews`] without views or with another number of depths, [`Error::View`] for a map of another size than its camera.
pub fn refine_by_patches(views: &[PosedView], depths: &[ArrayView2<'_, f32>]) -> Result<Array2<f32>> {
    if views.is_empty() || views.len() != depths.len() {
        return Err(Error::TooFewViews { views: views.len().min(depths.len()) });
    }
    for (view, depth) in views.iter().zip(depths) {
        view.validate()?;
        view.camera.check_map("depth", depth.dim())?;
    }
    let reference = Reference::new(views, depths);
    let slots = reference.height * reference.width.div_ceil(2);
    let first = [0, 1].map(|colour| -> Vec<Match> {
        let fitted = |slot| reference.known(colour, slot).map_or(Match::default(), |at| reference.first(at));
        (0..slots).into_par_iter().map(fitted).collect()
    });
    let mut matches = first.clone();
    for iteration in 0..ITERATIONS {
        for colour in [0, 1] {
            let mut own = std::mem::take(&mut matches[colour]);
            own.par_iter_mut().enumerate().for_each(|(slot, found)| {
                if let Some(at) = reference.known(colour, slot) {
                    *found = reference.improved(*found, &matches[1 - colour], at, iteration);
                }
            });
            matches[colour] = own;
        }
    }
    let moved = |(y, x): (usize, usize)| {
        let (at, colour, z) = (y * reference.width + x, (x + y) % 2, depths[0][(y, x)]);
        if reference.before[at] <= 0.0 {
            return z;
        }
        // The neighbours have moved since.
        let neighbours = reference.neighbours(&matches[1 - colour], at);
        let total = |found: &Match| found.cost + reference.apart(found.plane, at, &neighbours);
        let [old, new] = [&first, &matches].map(|matches| &matches[colour][reference.slot(at)]);
        if total(new) <= total(old) && new.back <= old.back + RETURN_SLACK { new.plane.w.recip() } else { z }
    };
    Ok(Array2::from_shape_fn(depths[0].dim(), moved))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane as Surface, room, scene};
    use mde_uncertainty::statistics::median;

    fn error(depth: &Array2<f32>, truth: &Array2<f32>) -> f64 {
        median(depth.iter().zip(truth).map(|(z, t)| f64::from((z / t - 1.0).abs()))).unwrap()
    }

    /// Depths off by 2 % in waves, a fifth of a pixel, come back on slanted walls; less where those of the other photographs are off, too.
    #[test]
    fn small_errors_shrink() {
        let (views, truth, _) = room(1.0);
        let wave = |x: usize, y: usize| 1.0 + 0.02 * ((x + 2 * y) as f32 / 5.0).sin();
        let depths: Vec<Array2<f32>> =
            truth.iter().map(|t| Array2::from_shape_fn(t.dim(), |(y, x)| wave(x, y) * t[(y, x)])).collect();
        let shrunk = |others: &[Array2<f32>]| {
            let maps: Vec<_> = std::iter::once(&depths[0]).chain(&others[1..]).map(|d| d.view()).collect();
            let found = refine_by_patches(&views, &maps).unwrap();
            error(&found, &truth[0]) / error(&depths[0], &truth[0])
        };
        let (alone, all) = (shrunk(&truth), shrunk(&depths));
        assert!(alone < 0.4 && all < 0.75, "{alone} {all}");
    }

    /// True depths hardly move, none of them by the range, and unknown ones stay unknown.
    #[test]
    fn true_depths_stay() {
        let (views, mut truth, _) = room(1.0);
        truth[0][(30, 40)] = 0.0;
        let maps: Vec<_> = truth.iter().map(|depth| depth.view()).collect();
        let found = refine_by_patches(&views, &maps).unwrap();
        assert_eq!(found[(30, 40)], 0.0);
        assert!(error(&found, &truth[0]) < 5e-4, "{}", error(&found, &truth[0]));
        let most = found.iter().zip(&truth[0]).filter(|(_, t)| **t > 0.0);
        assert!(most.map(|(z, t)| (z / t - 1.0).abs()).fold(0.0, f32::max) < RANGE + 0.002);
    }

    #[test]
    fn a_coordinate_is_its_whole_part_and_the_rest() {
        for coordinate in [0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 318.999, 4000.0, 2_097_151.5] {
            let (whole, rest) = split(coordinate);
            let exact = whole as f32 + rest == coordinate;
            assert!((0.0..=1.0).contains(&rest) && exact, "{coordinate}: {whole} {rest}");
        }
    }

    /// Without colours to compare there is nothing to move for.
    #[test]
    fn a_blank_wall_keeps_its_depth() {
        let (mut views, truth) =
            scene(&[Surface::slanted(2.0, 0.3, 0.1)], (40, 50), &[[0.0; 3], [0.2, 0.0, 0.0]]);
        views.iter_mut().for_each(|view| view.image.fill(0.5));
        let maps: Vec<_> = truth.iter().map(|depth| depth.view()).collect();
        let found = refine_by_patches(&views, &maps).unwrap();
        assert!(error(&found, &truth[0]) < 1e-3, "{}", error(&found, &truth[0]));
    }

    #[test]
    fn maps_and_views_have_to_belong_together() {
        let (views, truth) =
            scene(&[Surface::slanted(2.0, 0.0, 0.0)], (20, 30), &[[0.0; 3], [0.2, 0.0, 0.0]]);
        let maps: Vec<_> = truth.iter().map(|depth| depth.view()).collect();
        assert_eq!(refine_by_patches(&views, &maps[..1]), Err(Error::TooFewViews { views: 1 }));
        assert_eq!(refine_by_patches(&[], &[]), Err(Error::TooFewViews { views: 0 }));
        let small = Array2::ones((3, 4));
        assert!(matches!(refine_by_patches(&views, &[maps[0], small.view()]), Err(Error::View(_))));
    }
}
