//! Matching costs of every pixel on every surface: zero-mean normalised cross-correlation over a box, best half of the sources.

use mde_warp::PosedView;
use ndarray::{Array2, Zip};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::raster::luma;
use mde_warp::transfer::Transfer;

/// Half the side of the correlation window, pixels.
pub(crate) const RADIUS: usize = 2;
/// Its side.
pub(crate) const WINDOW: usize = 2 * RADIUS + 1;
/// Standard deviation of a grey value's noise, in sRGB units.
pub(crate) const NOISE: f32 = 2.0 / 255.0;
/// Cost 1 (no correlation, or a negative one), quantised.
pub(crate) const WORST: f32 = 254.0;
/// Cost of a source that does not have the pixel, and placeholder in the volume where none has it, until it is filled.
const UNSEEN: u8 = 255;
/// Rows that are computed together.
const BLOCK: usize = 48;
/// Surfaces whose costs are transposed together: the bytes of one word.
const GROUP: usize = 8;
/// Pixels whose costs are transposed or combined together.
const LANES: usize = 64;
/// A target depth below this share of the source depth counts as behind the camera.
const NEAR: f32 = 1e-4;
/// Luma 1 as it is stored.
const UNIT: f32 = 65_000.0;
/// Least product of a variance and the squared number of pixels, against rounding errors below zero.
const LEAST: f32 = 1e-12;
/// What is stored where a neighbour is masked or off the image.
const MISSING: u16 = u16::MAX;
/// Added to a number from 0 to 2^22 it leaves the nearest integer in the lowest bits: a conversion that vectorises.
const INTEGER: f32 = 8_388_608.0;

/// Costs `[height, width, surfaces]`, 0 to 254, surfaces fastest.
pub(crate) struct Volume {
    pub(crate) costs: Vec<u8>,
    pub(crate) surfaces: usize,
    /// Whether any source has the pixel, on any surface.
    pub(crate) seen: Array2<bool>,
}

/// One source view, ready to be sampled.
struct Source {
    /// For each pixel the luma of itself, its right, its lower and its diagonal neighbour, 16 bits each from the lowest;
    /// one more, all missing, for what is outside.
    quads: Vec<u64>,
    width: usize,
    height: usize,
    transfer: Transfer,
}

impl Source {
    fn new(reference: &PosedView, view: &PosedView) -> Self {
        let (h, w) = view.camera.dim();
        let stored = Zip::from(&luma(view.image.view())).and(&view.mask).map_collect(|&value, &kept| {
            if kept { (UNIT * value.clamp(0.0, 1.0)).round() as u16 } else { MISSING }
        });
        let at = |y: usize, x: usize| stored[(y.min(h - 1), x.min(w - 1))];
        let quad = |i: usize| {
            let (y, x) = (i / w, i % w);
            let corners = [at(y, x), at(y, x + 1), at(y + 1, x), at(y + 1, x + 1)];
            if corners.contains(&MISSING) {
                return u64::MAX;
            }
            corners.iter().rev().fold(0, |quad, &corner| (quad << 16) | u64::from(corner))
        };
        let quads = (0..h * w).map(quad).chain([u64::MAX]).collect();
        Self { quads, width: w, height: h, transfer: Transfer::new(reference, view) }
    }
}

/// The reference's side of the correlation.
struct Reference {
    width: usize,
    height: usize,
    /// Luma padded by [`RADIUS`] zeros to both sides of every row; zero where masked.
    padded: Vec<f32>,
    /// 1 where the mask holds.
    mask: Vec<f32>,
    /// Number of pixels in the window.
    count: Vec<f32>,
    /// Sum of luma in the window.
    sum: Vec<f32>,
    /// 1 / (number x standard deviation).
    scale: Vec<f32>,
}

impl Reference {
    fn new(view: &PosedView) -> Self {
        let (h, w) = view.camera.dim();
        let luma = luma(view.image.view());
        let stride = w + 2 * RADIUS;
        let mut padded = vec![0.0; h * stride];
        let mut mask = vec![0.0; h * w];
        for ((y, x), &value) in luma.indexed_iter() {
            if view.mask[(y, x)] {
                padded[y * stride + RADIUS + x] = value;
                mask[y * w + x] = 1.0;
            }
        }
        let (mut count, mut sum, mut scale) = (vec![1.0; h * w], vec![0.0; h * w], vec![0.0; h * w]);
        for y in 0..h {
            for x in 0..w {
                let (mut n, mut s, mut ss) = (0.0_f64, 0.0_f64, 0.0_f64);
                for v in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(h) {
                    for u in x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(w) {
                        let value = f64::from(padded[v * stride + RADIUS + u]);
                        n += f64::from(mask[v * w + u]);
                        s += value;
                        ss += value * value;
                    }
                }
                let i = y * w + x;
                count[i] = n.max(1.0) as f32;
                sum[i] = s as f32;
                let noise = f64::from(NOISE);
                scale[i] = (n * ss - s * s + n * n * noise * noise).max(1e-12).sqrt().recip() as f32;
            }
        }
        Self { width: w, height: h, padded, mask, count, sum, scale }
    }
}

/// Buffers of one thread.
struct Scratch {
    fraction_x: Vec<f32>,
    fraction_y: Vec<f32>,
    index: Vec<u32>,
    quads: Vec<u64>,
    warped: Vec<f32>,
    /// Horizontal sums of the warp, its square, and its product with the reference, for the lines of one window in turn.
    sums: [Vec<f32>; 3],
    /// Quantised costs of every source, `[source][row of the block][column]`.
    costs: Vec<Vec<u8>>,
    /// Their combination, `[surface of the group][row of the block][column]`.
    group: Vec<u8>,
}

impl Scratch {
    fn new(reference: &Reference, sources: usize) -> Self {
        let w = reference.width;
        Self {
            fraction_x: vec![0.0; w],
            fraction_y: vec![0.0; w],
            index: vec![0; w],
            quads: vec![0; w],
            warped: vec![0.0; w + 2 * RADIUS],
            sums: std::array::from_fn(|_| vec![0.0; WINDOW * w]),
            costs: vec![vec![0; BLOCK * w]; sources],
            group: vec![0; GROUP * BLOCK * w],
        }
    }
}

/// Inputs of a sweep.
pub(crate) struct Setup<'a> {
    pub(crate) reference: &'a PosedView,
    pub(crate) sources: &'a [&'a PosedView],
    /// Inverse depth of every pixel, row after row; a surface is a multiple of it.
    pub(crate) centre: &'a [f32],
    pub(crate) multiples: &'a [f32],
}

impl Volume {
    pub(crate) fn new(setup: &Setup<'_>) -> Self {
        let reference = Reference::new(setup.reference);
        let source = |view: &&PosedView| Source::new(setup.reference, view);
        let sources: Vec<Source> = setup.sources.iter().map(source).collect();
        let (w, h, surfaces) = (reference.width, reference.height, setup.multiples.len());
        let mut costs = vec![0_u8; w * h * surfaces];
        let arch = Arch::new();
        costs.par_chunks_mut(BLOCK * w * surfaces).enumerate().for_each_init(
            || Scratch::new(&reference, sources.len()),
            |scratch, (block, slab)| {
                let (reference, sources) = (&reference, &sources[..]);
                arch.dispatch(FillBlock { setup, reference, sources, scratch, top: block * BLOCK, slab });
            },
        );
        let seen = costs.par_chunks_mut(surfaces).map(fill_unseen).collect();
        Self { costs, surfaces, seen: Array2::from_shape_vec((h, w), seen).unwrap_or_default() }
    }
}

/// Surfaces on which no source has the pixel get the mean cost of the others.
fn fill_unseen(costs: &mut [u8]) -> bool {
    let (mut sum, mut number) = (0_u32, 0_u32);
    for &c in costs.iter().filter(|&&c| c != UNSEEN) {
        sum += u32::from(c);
        number += 1;
    }
    let mean = sum.checked_div(number).unwrap_or(0) as u8;
    costs.iter_mut().filter(|c| **c == UNSEEN).for_each(|c| *c = mean);
    number > 0
}

/// Costs of the rows of a block from `top` on. A struct and not a closure, so that all of it is compiled for the processor's vectors.
struct FillBlock<'a> {
    setup: &'a Setup<'a>,
    reference: &'a Reference,
    sources: &'a [Source],
    scratch: &'a mut Scratch,
    top: usize,
    slab: &'a mut [u8],
}

impl WithSimd for FillBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { setup, reference, sources, scratch, top, slab } = self;
        let (w, surfaces) = (reference.width, setup.multiples.len());
        let pixels = slab.len() / surfaces;
        for start in (0..surfaces).step_by(GROUP) {
            let multiples = &setup.multiples[start..(start + GROUP).min(surfaces)];
            for (slot, &multiple) in multiples.iter().enumerate() {
                for (s, source) in sources.iter().enumerate() {
                    let surface = Surface { setup, reference, source, multiple };
                    correlate(&surface, scratch, s, top, pixels / w);
                }
                best_half(&mut scratch.costs, &mut scratch.group[slot * BLOCK * w..][..pixels]);
            }
            for (chunk, slab) in slab.chunks_mut(LANES * surfaces).enumerate() {
                let mut words = [0_u64; LANES];
                let n = slab.len() / surfaces;
                for slot in 0..multiples.len() {
                    let costs = &scratch.group[slot * BLOCK * w + chunk * LANES..][..n];
                    for (word, &cost) in words.iter_mut().zip(costs) {
                        *word |= u64::from(cost) << (8 * slot);
                    }
                }
                for (costs, word) in slab.chunks_exact_mut(surfaces).zip(words) {
                    let here = &mut costs[start..start + multiples.len()];
                    here.copy_from_slice(&word.to_le_bytes()[..multiples.len()]);
                }
            }
        }
    }
}

/// One surface seen by one source.
struct Surface<'a> {
    setup: &'a Setup<'a>,
    reference: &'a Reference,
    source: &'a Source,
    multiple: f32,
}

/// Costs of the rows of a block: line by line, its margin too, the source is warped onto the surface and summed over
/// horizontal windows; as many lines as the window is high are kept, and summed.
#[inline(always)]
fn correlate(surface: &Surface<'_>, scratch: &mut Scratch, source: usize, top: usize, rows: usize) {
    let Surface { setup, reference, source: view, multiple } = *surface;
    let (w, r) = (reference.width, RADIUS);
    let Scratch { fraction_x, fraction_y, index, quads, warped, sums: [s1, s2, s3], costs, .. } = scratch;
    for line in 0..rows + 2 * r {
        let slot = line % WINDOW;
        let here = slot * w..(slot + 1) * w;
        let (l1, l2, l3) = (&mut s1[here.clone()], &mut s2[here.clone()], &mut s3[here]);
        if let Some(y) = (top + line).checked_sub(r).filter(|&y| y < reference.height) {
            places(view, y, &setup.centre[y * w..(y + 1) * w], multiple, index, fraction_x, fraction_y);
            for (quad, &i) in quads.iter_mut().zip(index.iter()) {
                *quad = view.quads[i as usize];
            }
            let mask = &reference.mask[y * w..(y + 1) * w];
            interpolate(quads, fraction_x, fraction_y, mask, &mut warped[r..r + w]);
            let stride = w + 2 * r;
            let luma = &reference.padded[y * stride..(y + 1) * stride];
            horizontal(warped, luma, l1, l2, l3);
        } else {
            [l1, l2, l3].into_iter().for_each(|sums| sums.fill(0.0));
        }
        if let Some(row) = line.checked_sub(2 * r) {
            let here = (top + row) * w..(top + row + 1) * w;
            correlation_row(
                [s1, s2, s3],
                &reference.count[here.clone()],
                &reference.sum[here.clone()],
                &reference.scale[here],
                &mut costs[source][row * w..(row + 1) * w],
            );
        }
    }
}

/// Where the pixels of row `y` at `multiple` times their inverse depths land: index of the upper left neighbour, and fractions.
#[inline(always)]
fn places(
    source: &Source,
    y: usize,
    centre: &[f32],
    multiple: f32,
    index: &mut [u32],
    fraction_x: &mut [f32],
    fraction_y: &mut [f32],
) {
    let m = &source.transfer.rotation;
    let t = &source.transfer.translation;
    let v = y as f64;
    let start: [f32; 3] = std::array::from_fn(|i| (m[(i, 1)] * v + m[(i, 2)]) as f32);
    let along: [f32; 3] = std::array::from_fn(|i| m[(i, 0)] as f32);
    let shift: [f32; 3] = std::array::from_fn(|i| t[i] as f32 * multiple);
    let (right, bottom) = ((source.width - 1) as f32, (source.height - 1) as f32);
    let stride = source.width as u32;
    let outside = (source.width * source.height) as u32;
    let n = centre.len();
    let (index, fraction_x, fraction_y) = (&mut index[..n], &mut fraction_x[..n], &mut fraction_y[..n]);
    for x in 0..n {
        let (u, d) = (x as i32 as f32, centre[x]);
        let z = start[2] + along[2] * u + shift[2] * d;
        let scale = 1.0 / z;
        let px = (start[0] + along[0] * u + shift[0] * d) * scale;
        let py = (start[1] + along[1] * u + shift[1] * d) * scale;
        let inside = (z > NEAR) & (px >= 0.0) & (px <= right) & (py >= 0.0) & (py <= bottom);
        let px = if inside { px } else { 0.0 };
        let py = if inside { py } else { 0.0 };
        let (x0, y0) = (px.floor(), py.floor());
        fraction_x[x] = px - x0;
        fraction_y[x] = py - y0;
        let at = integer(y0) * stride + integer(x0);
        index[x] = if inside { at } else { outside };
    }
}

/// A number from 0 to 2^22, rounded.
#[inline(always)]
fn integer(x: f32) -> u32 {
    (x + INTEGER).to_bits() & 0x7F_FFFF
}

/// Bilinear values, 0 where the reference is masked and NaN where the source misses a neighbour.
#[inline(always)]
fn interpolate(quads: &[u64], fraction_x: &[f32], fraction_y: &[f32], mask: &[f32], warped: &mut [f32]) {
    let n = warped.len();
    let (quads, fraction_x, fraction_y, mask) = (&quads[..n], &fraction_x[..n], &fraction_y[..n], &mask[..n]);
    for x in 0..n {
        let (low, high) = (quads[x] as u32, (quads[x] >> 32) as u32);
        let luma = |bits: u32| (bits & 0xFFFF) as i32 as f32;
        let (a, b, c, d) = (luma(low), luma(low >> 16), luma(high), luma(high >> 16));
        let (fx, fy) = (fraction_x[x], fraction_y[x]);
        let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
        let value = (top + fy * (bottom - top)) * (1.0 / UNIT);
        let value = if low == u32::MAX { f32::NAN } else { value };
        warped[x] = if mask[x] > 0.0 { value } else { 0.0 };
    }
}

#[inline(always)]
fn horizontal(warped: &[f32], luma: &[f32], s1: &mut [f32], s2: &mut [f32], s3: &mut [f32]) {
    let n = s1.len();
    let a: [&[f32]; WINDOW] = std::array::from_fn(|j| &warped[j..j + n]);
    let b: [&[f32]; WINDOW] = std::array::from_fn(|j| &luma[j..j + n]);
    let (s2, s3) = (&mut s2[..n], &mut s3[..n]);
    for i in 0..n {
        let (mut t1, mut t2, mut t3) = (0.0, 0.0, 0.0);
        for j in 0..WINDOW {
            let (x, y) = (a[j][i], b[j][i]);
            t1 += x;
            t2 += x * x;
            t3 += x * y;
        }
        s1[i] = t1;
        s2[i] = t2;
        s3[i] = t3;
    }
}

/// One row of quantised costs; `out` is an argument of its own: as such it overlaps nothing, and the loop vectorises.
#[inline(always)]
fn correlation_row([s1, s2, s3]: [&[f32]; 3], count: &[f32], sum: &[f32], scale: &[f32], out: &mut [u8]) {
    let w = out.len();
    let lines = |s| -> [&[f32]; WINDOW] {
        let s: &[f32] = s;
        std::array::from_fn(|j| &s[j * w..(j + 1) * w])
    };
    let (l1, l2, l3) = (lines(s1), lines(s2), lines(s3));
    let (count, sum, scale) = (&count[..w], &sum[..w], &scale[..w]);
    for x in 0..w {
        let (mut s1, mut s2, mut s3) = (0.0, 0.0, 0.0);
        for j in 0..WINDOW {
            s1 += l1[j][x];
            s2 += l2[j][x];
            s3 += l3[j][x];
        }
        let n = count[x];
        let covariance = n * s3 - s1 * sum[x];
        let variance = n * s2 - s1 * s1 + n * n * (NOISE * NOISE);
        // Not `max`, which would turn NaN into the bound.
        let variance = if variance < LEAST { LEAST } else { variance };
        let cost = 1.0 - covariance * scale[x] * inverse_root(variance);
        let capped = if cost > 0.0 { if cost < 1.0 { cost } else { 1.0 } } else { 0.0 };
        let quantised = integer(WORST * capped) as u8;
        out[x] = if cost.is_nan() { UNSEEN } else { quantised };
    }
}

/// 1 / sqrt(x) of a positive number to 5e-6, NaN of NaN: an estimate from the exponent and two steps of Newton's method.
#[inline(always)]
fn inverse_root(x: f32) -> f32 {
    let estimate = f32::from_bits(0x5F37_59DF_u32.wrapping_sub(x.to_bits() >> 1));
    let half = 0.5 * x;
    let better = estimate * (1.5 - half * estimate * estimate);
    better * (1.5 - half * better * better)
}

/// Mean of the lower half of the costs of the sources that see a pixel (rounded up).
#[inline(always)]
fn best_half(costs: &mut [Vec<u8>], out: &mut [u8]) {
    let (pixels, half) = (out.len(), costs.len().div_ceil(2));
    let mut valid = [0_u8; LANES];
    let mut sum = [0_u16; LANES];
    for start in (0..pixels).step_by(LANES) {
        let n = LANES.min(pixels - start);
        let here = start..start + n;
        valid.fill(0);
        for c in costs.iter() {
            for (v, &c) in valid.iter_mut().zip(&c[here.clone()]) {
                *v += u8::from(c != UNSEEN);
            }
        }
        // The lowest to the front, then the next: all pixels at once.
        for first in 0..half {
            for i in (first..costs.len() - 1).rev() {
                let (low, high) = costs.split_at_mut(i + 1);
                exchange(&mut low[i][here.clone()], &mut high[0][here.clone()]);
            }
        }
        // Half of the valid ones, rounded up: the i-th lowest is kept if there are more than 2 i valid.
        sum.fill(0);
        for (i, c) in costs[..half].iter().enumerate() {
            let least = 2 * i as u8;
            for ((s, &v), &c) in sum.iter_mut().zip(&valid).zip(&c[here.clone()]) {
                *s += if v > least { u16::from(c) } else { 0 };
            }
        }
        for ((out, &v), &s) in out[here].iter_mut().zip(&valid).zip(&sum) {
            let kept = f32::from((v >> 1) + (v & 1));
            let mean = f32::from(s) / if v > 0 { kept } else { 1.0 };
            *out = if v > 0 { integer(mean) as u8 } else { UNSEEN };
        }
    }
}

#[inline(always)]
fn exchange(a: &mut [u8], b: &mut [u8]) {
    for (a, b) in a.iter_mut().zip(b) {
        let (x, y) = (*a, *b);
        (*a, *b) = (x.min(y), x.max(y));
    }
}

#[cfg(test)]
mod tests;
