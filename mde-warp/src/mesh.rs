//! A depth map as a surface that is torn between objects.
//!
//! Pixels are joined into triangles, two for each square of four neighbours (a cell). Where the pixels of a cell lie on more than one
//! surface there is no triangle between the surfaces: each pixel keeps its quarter of the cell instead, with its surface's own slope, so
//! that two surfaces meet half-way between their pixels, and a structure one pixel thin is one pixel wide.

use crate::raster::{Corner, Projected, snap, triangle};
use crate::transfer::Transfer;
use crate::zbuffer::Hit;
use mde_uncertainty::GaussianDepth;

/// Offsets (column, row) of a cell's corners. `k ^ 1` is the neighbour of corner `k` in the row, `k ^ 2` in the column.
const OFFSET: [(f64, f64); 4] = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
/// The triangle that leaves out corner `k`, turning from x to y.
const WITHOUT: [[usize; 3]; 4] = [[1, 3, 2], [0, 3, 2], [0, 1, 3], [0, 1, 2]];

/// The part of a cell that a sample lies in: it decides which pixels are interpolated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Part {
    #[default]
    Whole,
    Without(u8),
    Quarter(u8),
}

/// A piece of the source surface: a cell, counted from the one before the first pixel, and a part of it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Patch {
    row: u32,
    column: u32,
    part: Part,
}

impl Patch {
    /// Whether samples here are interpolated between pixels rather than extrapolated from one.
    pub(crate) fn is_joined(self) -> bool {
        !matches!(self.part, Part::Quarter(_))
    }

    /// The source pixels `(row, column)` that a sample at source column `u` and row `v` interpolates, with their weights
    /// (>= 0, summing to 1). All of them are on one surface.
    pub(crate) fn pixels(self, u: f64, v: f64) -> impl Iterator<Item = ((usize, usize), f64)> {
        let (s, t) = (u - (f64::from(self.column) - 1.0), v - (f64::from(self.row) - 1.0));
        let weights = match self.part {
            Part::Whole => [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
            Part::Without(0) => [0.0, 1.0 - t, 1.0 - s, s + t - 1.0],
            Part::Without(1) => [1.0 - t, 0.0, t - s, s],
            Part::Without(2) => [1.0 - s, s - t, 0.0, t],
            Part::Without(_) => [1.0 - s - t, s, t, 0.0],
            Part::Quarter(k) => std::array::from_fn(|i| if i == usize::from(k) { 1.0 } else { 0.0 }),
        };
        let weights = weights.map(snap);
        let total: f64 = weights.iter().sum();
        let pixel = move |k: usize| {
            let (row, column) = (self.row as usize + (k >> 1), self.column as usize + (k & 1));
            (row.wrapping_sub(1), column.wrapping_sub(1))
        };
        (0..4).filter(move |&k| weights[k] > 0.0).map(move |k| (pixel(k), weights[k] / total))
    }
}

/// The surface of one depth map, projected into one target camera.
pub(crate) struct Mesh {
    pub(crate) transfer: Transfer,
    tear: f64,
    /// Columns of the padded maps below, which have a frame of missing pixels about them.
    stride: usize,
    /// 1 / z, 0 where missing.
    disparity: Vec<f64>,
    projected: Vec<Projected>,
}

impl Mesh {
    /// Triangles are torn where the disparities of their corners differ by more than `tear` of the largest. Pixels that are
    /// missing or not positive are left out.
    pub(crate) fn new(depth: &GaussianDepth, transfer: Transfer, tear: f64) -> Self {
        let (height, width) = depth.dim();
        let stride = width + 2;
        let mut disparity = vec![0.0; stride * (height + 2)];
        let mut projected = vec![Projected::default(); disparity.len()];
        for row in 0..height {
            for column in 0..width {
                let Some((mean, _)) = depth.get(row, column).filter(|&(mean, _)| mean > 0.0) else {
                    continue;
                };
                let index = (row + 1) * stride + column + 1;
                disparity[index] = f64::from(mean).recip();
                let (u, v) = (column as f64, row as f64);
                projected[index] = Projected::new(&transfer, u, v, disparity[index]);
            }
        }
        Self { transfer, tear, stride, disparity, projected }
    }

    /// Every sample of the surface at a target pixel centre. A pixel may get several, of one surface or of many.
    pub(crate) fn rasterise(&self, mut emit: impl FnMut((usize, usize), Hit)) {
        let rows = self.disparity.len() / self.stride;
        for row in 0..rows - 1 {
            for column in 0..self.stride - 1 {
                let d = std::array::from_fn(|k| self.disparity[self.corner_index(row, column, k)]);
                Cell { mesh: self, row, column, d }.draw(&mut emit);
            }
        }
    }

    fn corner_index(&self, row: usize, column: usize, k: usize) -> usize {
        (row + (k >> 1)) * self.stride + column + (k & 1)
    }

    /// The difference of the largest and the least, where all are there and it is within the tear threshold: they lie on one surface.
    fn spread(&self, disparities: &[f64]) -> Option<f64> {
        let (low, high) =
            disparities.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), &d| (l.min(d), h.max(d)));
        (low > 0.0 && high - low <= self.tear * high).then_some(high - low)
    }

    /// Disparity per pixel (to the right, downwards) of the surface at a pixel, from its neighbours on that surface.
    fn slope(&self, index: usize) -> (f64, f64) {
        let along = |step: usize| {
            let here = self.disparity[index];
            let neighbour = |i: usize| Some(self.disparity[i]).filter(|&d| self.spread(&[here, d]).is_some());
            match (neighbour(index - step), neighbour(index + step)) {
                (Some(before), Some(after)) => 0.5 * (after - before),
                (Some(before), None) => here - before,
                (None, Some(after)) => after - here,
                (None, None) => 0.0,
            }
        };
        (along(1), along(self.stride))
    }
}

/// A cell of a mesh, with the disparities of its corners.
struct Cell<'a> {
    mesh: &'a Mesh,
    row: usize,
    column: usize,
    d: [f64; 4],
}

impl Cell<'_> {
    #[inline]
    fn draw(&self, emit: &mut impl FnMut((usize, usize), Hit)) {
        let d = &self.d;
        if self.mesh.spread(d).is_some() {
            let split = if (d[1] - d[2]).abs() <= (d[0] - d[3]).abs() { [3, 0] } else { [2, 1] };
            self.triangles(&split, Part::Whole, emit);
        } else if d.iter().any(|&d| d > 0.0) {
            self.torn(emit);
        }
    }

    fn triangles(&self, without: &[usize], part: Part, emit: &mut impl FnMut((usize, usize), Hit)) {
        for &k in without {
            self.triangle(&WITHOUT[k].map(|k| self.corner(k)), part, emit);
        }
    }

    fn triangle(&self, corners: &[Corner; 3], part: Part, emit: &mut impl FnMut((usize, usize), Hit)) {
        let patch = Patch { row: self.row as u32, column: self.column as u32, part };
        triangle(corners, self.mesh.transfer.dim(), patch, emit);
    }

    /// A cell that lies on more than one surface, or on one and a piece.
    #[cold]
    fn torn(&self, emit: &mut impl FnMut((usize, usize), Hit)) {
        let ranges: [_; 4] = std::array::from_fn(|k| self.mesh.spread(&WITHOUT[k].map(|k| self.d[k])));
        for split in [[3, 0], [2, 1]] {
            if split.iter().all(|&k| ranges[k].is_some()) {
                return self.triangles(&split, Part::Whole, emit);
            }
        }
        let best = (0..4).filter_map(|k| Some((k, ranges[k]?))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((left_out, _)) = best else {
            return (0..4).for_each(|k| self.quarter(k, [true, true], emit));
        };
        self.triangles(&[left_out], Part::Without(left_out as u8), emit);
        self.quarter(left_out, [true, true], emit);
        // The triangle holds half of its neighbours' quarters already.
        self.quarter(left_out ^ 1, [true, false], emit);
        self.quarter(left_out ^ 2, [false, true], emit);
    }

    /// The quarter of corner `k` as two triangles, either of which may be left out: the one towards the row's neighbour and
    /// the one towards the column's.
    fn quarter(&self, k: usize, sides: [bool; 2], emit: &mut impl FnMut((usize, usize), Hit)) {
        if self.d[k] <= 0.0 {
            return;
        }
        let (s, t) = OFFSET[k];
        let pixel = self.corner(k);
        let surface = self.surface(k);
        let middle = self.point(k, surface, 0.5, 0.5);
        let mut draw = |a: Corner, b: Corner| {
            // The cell is mirrored for corners 1 and 2.
            let corners = if k == 1 || k == 2 { [pixel, b, a] } else { [pixel, a, b] };
            self.triangle(&corners, Part::Quarter(k as u8), emit);
        };
        let members = |other: usize| surface & (1 << k | 1 << other);
        if sides[0] {
            draw(self.point(k, members(k ^ 1), 0.5, t), middle);
        }
        if sides[1] {
            draw(middle, self.point(k, members(k ^ 2), s, 0.5));
        }
    }

    /// The corners, as bits, that hang together with corner `k`.
    fn surface(&self, k: usize) -> u8 {
        let joined = |a: usize, b: usize| self.mesh.spread(&[self.d[a], self.d[b]]).is_some();
        let mut bits = 1 << k;
        for _ in 0..3 {
            for next in 0..4 {
                if (0..4).any(|member| bits & (1 << member) != 0 && joined(member, next)) {
                    bits |= 1 << next;
                }
            }
        }
        bits
    }

    fn corner(&self, k: usize) -> Corner {
        let (s, t) = OFFSET[k];
        let projected = self.mesh.projected[self.mesh.corner_index(self.row, self.column, k)];
        Corner { projected, u: self.column as f64 - 1.0 + s, v: self.row as f64 - 1.0 + t }
    }

    /// The point `(s, t)` of the cell on the surface of corner `k`: the mean of the extrapolations from `members`, so that
    /// neighbouring quarters of a surface meet.
    fn point(&self, k: usize, members: u8, s: f64, t: f64) -> Corner {
        let (mut sum, mut count) = (0.0, 0.0);
        for member in (0..4).filter(|member| members & (1 << member) != 0) {
            let (gx, gy) = self.mesh.slope(self.mesh.corner_index(self.row, self.column, member));
            let (ms, mt) = OFFSET[member];
            sum += self.d[member] + gx * (s - ms) + gy * (t - mt);
            count += 1.0;
        }
        let disparity = (sum / count).clamp(0.5 * self.d[k], 2.0 * self.d[k]);
        let (u, v) = (self.column as f64 - 1.0 + s, self.row as f64 - 1.0 + t);
        Corner { projected: Projected::new(&self.mesh.transfer, u, v, disparity), u, v }
    }
}
