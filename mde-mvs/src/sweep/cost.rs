//! Matching costs of every pixel on every surface: zero-mean normalised cross-correlation over a box, best half of the
//! sources.

use mde_warp::PosedView;
use ndarray::Array2;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::geometry::Transfer;
use crate::raster::luma;

/// Cost 1 (no correlation, or a negative one), quantised.
pub(crate) const WORST: f32 = 254.0;
/// Placeholder in the volume where no source has the pixel, until it is filled.
const UNSEEN: u8 = 255;
/// Cost of a source that does not have the pixel, above every real one.
const ABSENT: f32 = 4.0;
/// Rows that are computed together.
const BLOCK: usize = 24;
/// Pixels that are combined together.
const LANES: usize = 64;
/// Surfaces whose costs are transposed together.
const GROUP: usize = 16;
/// A target depth below this share of the source depth counts as behind the camera.
const NEAR: f32 = 1e-4;

/// Costs `[height, width, surfaces]`, 0 to 254, surfaces fastest.
pub(crate) struct Volume {
    pub(crate) costs: Vec<u8>,
    pub(crate) surfaces: usize,
    /// Whether any source has the pixel, on any surface.
    pub(crate) seen: Array2<bool>,
}

/// One source view, ready to be sampled.
struct Source {
    /// For each pixel itself, its right, its lower and its diagonal neighbour; one more, NaN, for all that is outside.
    quads: Vec<[f32; 4]>,
    width: usize,
    height: usize,
    transfer: Transfer,
}

impl Source {
    fn new(reference: &PosedView, view: &PosedView) -> Self {
        let (h, w) = view.camera.dim();
        let luma = luma(view.image.view());
        let at = |y: usize, x: usize| {
            let p = (y.min(h - 1), x.min(w - 1));
            if view.mask[p] { luma[p] } else { f32::NAN }
        };
        let mut quads: Vec<[f32; 4]> = Vec::with_capacity(h * w + 1);
        for y in 0..h {
            quads.extend((0..w).map(|x| [at(y, x), at(y, x + 1), at(y + 1, x), at(y + 1, x + 1)]));
        }
        quads.push([f32::NAN; 4]);
        Self { quads, width: w, height: h, transfer: Transfer::new(reference, view) }
    }
}

/// The reference's side of the correlation.
struct Reference {
    width: usize,
    height: usize,
    radius: usize,
    /// Luma padded by `radius` zeros to both sides of every row; zero where masked.
    padded: Vec<f32>,
    /// 1 where the mask holds.
    mask: Vec<f32>,
    /// Number of pixels in the window.
    count: Vec<f32>,
    /// Sum of luma in the window.
    sum: Vec<f32>,
    /// 1 / (number x standard deviation).
    scale: Vec<f32>,
    noise: f32,
}

impl Reference {
    fn new(view: &PosedView, radius: usize, noise: f32) -> Self {
        let (h, w) = view.camera.dim();
        let luma = luma(view.image.view());
        let stride = w + 2 * radius;
        let mut padded = vec![0.0; h * stride];
        let mut mask = vec![0.0; h * w];
        for ((y, x), &value) in luma.indexed_iter() {
            if view.mask[(y, x)] {
                padded[y * stride + radius + x] = value;
                mask[y * w + x] = 1.0;
            }
        }
        let (mut count, mut sum, mut scale) = (vec![1.0; h * w], vec![0.0; h * w], vec![0.0; h * w]);
        for y in 0..h {
            for x in 0..w {
                let (mut n, mut s, mut ss) = (0.0_f64, 0.0_f64, 0.0_f64);
                for v in y.saturating_sub(radius)..(y + radius + 1).min(h) {
                    for u in x.saturating_sub(radius)..(x + radius + 1).min(w) {
                        let value = f64::from(padded[v * stride + radius + u]);
                        n += f64::from(mask[v * w + u]);
                        s += value;
                        ss += value * value;
                    }
                }
                let i = y * w + x;
                count[i] = n.max(1.0) as f32;
                sum[i] = s as f32;
                let noise = f64::from(noise);
                scale[i] = (n * ss - s * s + n * n * noise * noise).max(1e-12).sqrt().recip() as f32;
            }
        }
        Self { width: w, height: h, radius, padded, mask, count, sum, scale, noise }
    }
}

/// Buffers of one thread.
struct Scratch {
    inverse_depth: Vec<f32>,
    fraction_x: Vec<f32>,
    fraction_y: Vec<f32>,
    index: Vec<i32>,
    warped: Vec<f32>,
    /// Horizontal sums of the warp, its square, and its product with the reference; one row after the other.
    sums: [Vec<f32>; 3],
    /// Costs of every source, `[source][row of the block][column]`.
    costs: Vec<Vec<f32>>,
    /// Quantised costs `[surface of the group][row of the block][column]`.
    group: Vec<u8>,
}

impl Scratch {
    fn new(reference: &Reference, sources: usize) -> Self {
        let (w, r) = (reference.width, reference.radius);
        let rows = BLOCK + 2 * r;
        Self {
            inverse_depth: vec![0.0; w],
            fraction_x: vec![0.0; w],
            fraction_y: vec![0.0; w],
            index: vec![0; w],
            warped: vec![0.0; w + 2 * r],
            sums: std::array::from_fn(|_| vec![0.0; rows * w]),
            costs: vec![vec![0.0; BLOCK * w]; sources],
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
    pub(crate) radius: usize,
    pub(crate) noise: f32,
}

impl Volume {
    pub(crate) fn new(setup: &Setup<'_>) -> Self {
        let reference = Reference::new(setup.reference, setup.radius, setup.noise);
        let sources: Vec<Source> =
            setup.sources.iter().map(|view| Source::new(setup.reference, view)).collect();
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
        let mut seen = Array2::from_elem((h, w), false);
        if let Some(seen) = seen.as_slice_mut() {
            costs.par_chunks_mut(surfaces).zip(seen.par_iter_mut()).for_each(|(costs, seen)| {
                *seen = fill_unseen(costs);
            });
        }
        Self { costs, surfaces, seen }
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

/// Costs of the rows of a block from `top` on. A struct and not a closure, so that all of it is compiled for the
/// processor's vectors.
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
        fill_block(self);
    }
}

#[inline(always)]
fn fill_block(block: FillBlock<'_>) {
    let FillBlock { setup, reference, sources, scratch, top, slab } = block;
    let (w, surfaces) = (reference.width, setup.multiples.len());
    let rows = slab.len() / (w * surfaces);
    for start in (0..surfaces).step_by(GROUP) {
        let multiples = &setup.multiples[start..(start + GROUP).min(surfaces)];
        for (slot, &multiple) in multiples.iter().enumerate() {
            for (s, source) in sources.iter().enumerate() {
                window_sums(setup, reference, source, scratch, top, rows, multiple);
                correlation(reference, scratch, s, top, rows);
            }
            best_half(&mut scratch.costs, rows * w, &mut scratch.group[slot * BLOCK * w..]);
        }
        for (pixel, costs) in slab.chunks_exact_mut(surfaces).enumerate() {
            for (slot, cost) in costs[start..start + multiples.len()].iter_mut().enumerate() {
                *cost = scratch.group[slot * BLOCK * w + pixel];
            }
        }
    }
}

/// Warps the rows of a block and its margin onto a surface, and sums over horizontal windows.
#[inline(always)]
fn window_sums(
    setup: &Setup<'_>,
    reference: &Reference,
    source: &Source,
    scratch: &mut Scratch,
    top: usize,
    rows: usize,
    multiple: f32,
) {
    let (w, r) = (reference.width, reference.radius);
    for line in 0..rows + 2 * r {
        let here = line * w..(line + 1) * w;
        let Some(y) = (top + line).checked_sub(r).filter(|&y| y < reference.height) else {
            scratch.sums.iter_mut().for_each(|s| s[here.clone()].fill(0.0));
            continue;
        };
        let centre = &setup.centre[y * w..(y + 1) * w];
        for (inverse, &c) in scratch.inverse_depth.iter_mut().zip(centre) {
            *inverse = c * multiple;
        }
        places(source, y, scratch);
        let mask = &reference.mask[y * w..(y + 1) * w];
        for (x, &kept) in mask.iter().enumerate() {
            let [a, b, c, d] = source.quads[scratch.index[x] as usize];
            let (fx, fy) = (scratch.fraction_x[x], scratch.fraction_y[x]);
            let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
            let value = top + fy * (bottom - top);
            scratch.warped[r + x] = if kept > 0.0 { value } else { 0.0 };
        }
        let stride = w + 2 * r;
        let luma = &reference.padded[y * stride..(y + 1) * stride];
        let [s1, s2, s3] = &mut scratch.sums;
        let (s1, s2, s3) = (&mut s1[here.clone()], &mut s2[here.clone()], &mut s3[here]);
        match r {
            1 => horizontal::<3>(&scratch.warped, luma, s1, s2, s3),
            2 => horizontal::<5>(&scratch.warped, luma, s1, s2, s3),
            3 => horizontal::<7>(&scratch.warped, luma, s1, s2, s3),
            4 => horizontal::<9>(&scratch.warped, luma, s1, s2, s3),
            _ => horizontal::<11>(&scratch.warped, luma, s1, s2, s3),
        }
    }
}

/// Where the pixels of row `y` at their inverse depths land: index of the upper left neighbour, and fractions.
#[inline(always)]
fn places(source: &Source, y: usize, scratch: &mut Scratch) {
    let m = &source.transfer.rotation;
    let t = &source.transfer.translation;
    let v = y as f64;
    let start: [f32; 3] = std::array::from_fn(|i| (m[(i, 1)] * v + m[(i, 2)]) as f32);
    let along: [f32; 3] = std::array::from_fn(|i| m[(i, 0)] as f32);
    let shift: [f32; 3] = std::array::from_fn(|i| t[i] as f32);
    let (right, bottom) = ((source.width - 1) as f32, (source.height - 1) as f32);
    let stride = source.width as i32;
    let outside = (source.width * source.height) as i32;
    let n = scratch.inverse_depth.len();
    let inverse_depth = &scratch.inverse_depth[..n];
    let (index, fraction_x) = (&mut scratch.index[..n], &mut scratch.fraction_x[..n]);
    let fraction_y = &mut scratch.fraction_y[..n];
    for x in 0..n {
        let (u, d) = (x as f32, inverse_depth[x]);
        let z = start[2] + along[2] * u + shift[2] * d;
        let scale = 1.0 / z;
        let px = (start[0] + along[0] * u + shift[0] * d) * scale;
        let py = (start[1] + along[1] * u + shift[1] * d) * scale;
        let inside = (z > NEAR) & (px >= 0.0) & (px <= right) & (py >= 0.0) & (py <= bottom);
        let (px, py) = if inside { (px, py) } else { (0.0, 0.0) };
        let (x0, y0) = (px.floor(), py.floor());
        fraction_x[x] = px - x0;
        fraction_y[x] = py - y0;
        let at = y0 as i32 * stride + x0 as i32;
        index[x] = if inside { at } else { outside };
    }
}

#[inline(always)]
fn horizontal<const WINDOW: usize>(
    warped: &[f32],
    luma: &[f32],
    s1: &mut [f32],
    s2: &mut [f32],
    s3: &mut [f32],
) {
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

/// Costs of a block from its horizontal sums.
#[inline(always)]
fn correlation(reference: &Reference, scratch: &mut Scratch, source: usize, top: usize, rows: usize) {
    match reference.radius {
        1 => correlation_rows::<3>(reference, scratch, source, top, rows),
        2 => correlation_rows::<5>(reference, scratch, source, top, rows),
        3 => correlation_rows::<7>(reference, scratch, source, top, rows),
        4 => correlation_rows::<9>(reference, scratch, source, top, rows),
        _ => correlation_rows::<11>(reference, scratch, source, top, rows),
    }
}

#[inline(always)]
fn correlation_rows<const WINDOW: usize>(
    reference: &Reference,
    scratch: &mut Scratch,
    source: usize,
    top: usize,
    rows: usize,
) {
    let w = reference.width;
    let squared = reference.noise * reference.noise;
    for row in 0..rows {
        let here = (top + row) * w..(top + row + 1) * w;
        let (count, sum, scale) =
            (&reference.count[here.clone()], &reference.sum[here.clone()], &reference.scale[here]);
        let lines = |s: usize| -> [&[f32]; WINDOW] {
            std::array::from_fn(|j| &scratch.sums[s][(row + j) * w..(row + j + 1) * w])
        };
        let (l1, l2, l3) = (lines(0), lines(1), lines(2));
        let out = &mut scratch.costs[source][row * w..(row + 1) * w];
        for x in 0..w {
            let (mut s1, mut s2, mut s3) = (0.0, 0.0, 0.0);
            for j in 0..WINDOW {
                s1 += l1[j][x];
                s2 += l2[j][x];
                s3 += l3[j][x];
            }
            let n = count[x];
            let noise = n * n * squared;
            let covariance = n * s3 - s1 * sum[x];
            let variance = n * s2 - s1 * s1 + noise;
            let cost = 1.0 - covariance * scale[x] / variance.sqrt();
            out[x] = if cost < ABSENT { cost } else { ABSENT };
        }
    }
}

/// Mean of the lower half of the costs of the sources that see a pixel (rounded up), quantised.
#[inline(always)]
fn best_half(costs: &mut [Vec<f32>], pixels: usize, out: &mut [u8]) {
    // A sorting network over sources, all pixels at once.
    for last in (1..costs.len()).rev() {
        for i in 0..last {
            let (low, high) = costs.split_at_mut(i + 1);
            let (a, b) = (&mut low[i][..pixels], &mut high[0][..pixels]);
            for (a, b) in a.iter_mut().zip(b) {
                let (x, y) = (*a, *b);
                *a = if x < y { x } else { y };
                *b = if x < y { y } else { x };
            }
        }
    }
    let mut kept = [0.0_f32; LANES];
    let mut sum = [0.0_f32; LANES];
    for start in (0..pixels).step_by(LANES) {
        let n = LANES.min(pixels - start);
        kept.fill(0.0);
        sum.fill(0.0);
        // Half of the valid ones, rounded up: the i-th lowest is kept if there are more than 2 i valid.
        for c in costs.iter() {
            for (k, &c) in kept.iter_mut().zip(&c[start..start + n]) {
                *k += if c < ABSENT { 0.5 } else { 0.0 };
            }
        }
        for (i, c) in costs.iter().enumerate() {
            for ((s, &k), &c) in sum.iter_mut().zip(&kept).zip(&c[start..start + n]) {
                *s += if k > i as f32 { c } else { 0.0 };
            }
        }
        for ((out, &k), &s) in out[start..start + n].iter_mut().zip(&kept).zip(&sum) {
            let mean = (s / k.ceil().max(1.0)).clamp(0.0, 1.0);
            let cost = (WORST * mean + 0.5) as u8;
            *out = if k > 0.0 { cost } else { UNSEEN };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, pose_at, render};
    use mde_warp::PinholeCamera;
    use proptest::prelude::*;

    /// The cost in `f64`, straight from the definition; nothing where a window comes near the source's edge.
    fn reference_cost(setup: &Setup<'_>, x: usize, y: usize, multiple: f32) -> Option<f64> {
        let (h, w) = setup.reference.camera.dim();
        let grey = luma(setup.reference.image.view());
        let r = setup.radius;
        let mut costs = Vec::new();
        for source in setup.sources {
            let transfer = Transfer::new(setup.reference, source);
            let there = luma(source.image.view());
            let (bottom, right) = ((there.nrows() - 1) as f64, (there.ncols() - 1) as f64);
            let (mut a, mut b) = (Vec::new(), Vec::new());
            let mut outside = false;
            for v in y.saturating_sub(r)..(y + r + 1).min(h) {
                for u in x.saturating_sub(r)..(x + r + 1).min(w) {
                    let inverse = f64::from(setup.centre[v * w + u] * multiple);
                    let seen = transfer.at(u as f64, v as f64, inverse)?;
                    let margin = seen.x.min(seen.y).min(right - seen.x).min(bottom - seen.y);
                    if margin.abs() < 1e-3 {
                        return None;
                    }
                    if margin < 0.0 {
                        outside = true;
                        continue;
                    }
                    let (x0, y0) = (seen.x as usize, seen.y as usize);
                    let (fx, fy) = (seen.x - x0 as f64, seen.y - y0 as f64);
                    let at = |y: usize, x: usize| f64::from(there[(y, x)]);
                    let top = at(y0, x0) + fx * (at(y0, x0 + 1) - at(y0, x0));
                    let low = at(y0 + 1, x0) + fx * (at(y0 + 1, x0 + 1) - at(y0 + 1, x0));
                    a.push(f64::from(grey[(v, u)]));
                    b.push(top + fy * (low - top));
                }
            }
            if outside {
                continue;
            }
            let n = a.len() as f64;
            let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
            let (ma, mb) = (mean(&a), mean(&b));
            let product = |p: &[f64], mp: f64, q: &[f64], mq: f64| {
                p.iter().zip(q).map(|(x, y)| (x - mp) * (y - mq)).sum::<f64>() / n
            };
            let noise = f64::from(setup.noise).powi(2);
            let scale = ((product(&a, ma, &a, ma) + noise) * (product(&b, mb, &b, mb) + noise)).sqrt();
            costs.push(1.0 - product(&a, ma, &b, mb) / scale);
        }
        costs.sort_by(f64::total_cmp);
        let kept = costs.len().div_ceil(2);
        (kept > 0).then(|| costs[..kept].iter().sum::<f64>() / kept as f64)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn costs_agree_with_the_definition(
            slant in -0.4..0.4_f64, dx in -0.3..0.3_f64, dy in -0.2..0.2_f64, dz in -0.3..0.3_f64,
            turn in -0.1..0.1_f64, radius in 1..=5_usize, size in (20..50_usize, 20..60_usize),
        ) {
            let camera = PinholeCamera::from_fov(55.0, size.1, size.0).unwrap();
            let plane = [Plane::slanted(2.0, slant, 0.1)];
            let view = |centre, angles| render(&plane, camera, pose_at(centre, angles), 0.2);
            let (reference, depth) = view([0.0; 3], [0.0; 3]);
            let others = [
                view([dx, dy, dz], [0.0, turn, 0.02]).0,
                view([-dy, dx, 0.0], [turn, 0.0, 0.0]).0,
                view([0.1, 0.0, 0.0], [0.0; 3]).0,
            ];
            let sources: Vec<&PosedView> = others.iter().collect();
            let centre: Vec<f32> = depth.iter().map(|z| z.recip()).collect();
            let multiples: Vec<f32> = (0..21).map(|k| 0.7 + 0.03 * k as f32).collect();
            let setup = Setup {
                reference: &reference, sources: &sources, centre: &centre, multiples: &multiples, radius, noise: 0.01,
            };
            let volume = Volume::new(&setup);
            for y in (0..size.0).step_by(5) {
                for x in (0..size.1).step_by(7) {
                    for (k, &multiple) in multiples.iter().enumerate().step_by(3) {
                        let Some(exact) = reference_cost(&setup, x, y, multiple) else { continue };
                        let found = f64::from(volume.costs[(y * size.1 + x) * 21 + k]) / f64::from(WORST);
                        prop_assert!((found - exact.clamp(0.0, 1.0)).abs() < 4e-3, "{x} {y} {k}: {found} {exact}");
                    }
                }
            }
        }
    }
}
