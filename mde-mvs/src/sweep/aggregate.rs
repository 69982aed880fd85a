//! Semi-global matching: costs smoothed along straight paths.
//!
//! Along a direction \\( r \\) the path cost of surface \\( k \\) at pixel \\( p \\) is (Hirschmueller, 2008)
//!
//! \\[ L_r(p, k) = C(p, k) + \min\{ L_r(p-r, k),\; L_r(p-r, k \pm 1) + P_1,\; \min_i L_r(p-r, i) + P_2 \}
//!    - \min_i L_r(p-r, i) . \\]
//!
//! The sum over \\( n \\) directions less \\( (n-1)\,C \\) counts every cost once and approximates a min-marginal
//! (Drory et al., 2014).

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::cost::Volume;

/// Larger than any path cost, and small enough that a penalty may be added.
const FAR: u16 = 1 << 14;

/// Penalties for a change of surface between neighbours, in quantised costs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Penalties {
    /// By one surface.
    pub(crate) small: u16,
    /// By more, between pixels of equal luma.
    pub(crate) large: u16,
    /// Difference of luma that halves the large one.
    pub(crate) edge: f32,
}

impl Penalties {
    #[inline(always)]
    fn between(&self, a: f32, b: f32) -> u16 {
        let large = f32::from(self.large) / (1.0 + (a - b).abs() / self.edge);
        (large as u16).max(self.small + 1)
    }
}

/// One step along a path. `before` and `after` have one more slot at either end; the lowest of `after` comes back.
#[inline(always)]
fn step(
    costs: &[u8],
    before: &[u16],
    lowest: u16,
    (small, large): (u16, u16),
    after: &mut [u16],
    sum: &mut [u16],
) -> u16 {
    let n = costs.len();
    let (left, middle, right) = (&before[..n], &before[1..=n], &before[2..n + 2]);
    after[0] = FAR;
    after[n + 1] = FAR;
    let (after, sum) = (&mut after[1..=n], &mut sum[..n]);
    let jump = lowest + large;
    let mut least = u16::MAX;
    for k in 0..n {
        let near = left[k].min(right[k]) + small;
        let path = u16::from(costs[k]) + middle[k].min(near).min(jump) - lowest;
        after[k] = path;
        sum[k] += path;
        least = least.min(path);
    }
    least
}

/// Sums over 4 or 8 directions less the costs counted twice, `[height, width, surfaces]`.
///
/// `luma` has the pixels row after row.
pub(crate) fn aggregate(
    volume: &Volume,
    luma: &[f32],
    width: usize,
    penalties: &Penalties,
    diagonals: bool,
) -> Vec<u16> {
    let k = volume.surfaces;
    let mut sums = vec![0_u16; volume.costs.len()];
    let arch = Arch::new();
    let rows = sums.par_chunks_mut(width * k).zip(volume.costs.par_chunks(width * k));
    rows.zip(luma.par_chunks(width)).for_each(|((sums, costs), luma)| {
        arch.dispatch(AlongRow { costs, luma, k, penalties, sums });
    });
    for upwards in [false, true] {
        across_rows(volume, luma, width, penalties, diagonals, upwards, &mut sums);
    }
    let twice = if diagonals { 7 } else { 3 };
    sums.par_chunks_mut(width * k).zip(volume.costs.par_chunks(width * k)).for_each(|(sums, costs)| {
        for (sum, &cost) in sums.iter_mut().zip(costs) {
            *sum -= twice * u16::from(cost);
        }
    });
    sums
}

/// Both horizontal directions of one row. Structs and not closures, so that all of it is compiled for the processor's
/// vectors.
struct AlongRow<'a> {
    costs: &'a [u8],
    luma: &'a [f32],
    k: usize,
    penalties: &'a Penalties,
    sums: &'a mut [u16],
}

impl WithSimd for AlongRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        along_row(self);
    }
}

#[inline(always)]
fn along_row(row: AlongRow<'_>) {
    let AlongRow { costs, luma, k, penalties, sums } = row;
    let width = luma.len();
    let (mut before, mut after) = (vec![0_u16; k + 2], vec![0_u16; k + 2]);
    for leftwards in [false, true] {
        before.fill(0);
        let (mut lowest, mut previous) = (0, None);
        for i in 0..width {
            let x = if leftwards { width - 1 - i } else { i };
            let large = penalties.between(luma[x], previous.unwrap_or(luma[x]));
            let here = x * k..(x + 1) * k;
            let pair = (penalties.small, large);
            lowest = step(&costs[here.clone()], &before, lowest, pair, &mut after, &mut sums[here]);
            std::mem::swap(&mut before, &mut after);
            previous = Some(luma[x]);
        }
    }
}

/// The vertical and the two diagonal directions, row by row; columns of a row are independent.
fn across_rows(
    volume: &Volume,
    luma: &[f32],
    width: usize,
    penalties: &Penalties,
    diagonals: bool,
    upwards: bool,
    sums: &mut [u16],
) {
    let shifts: &[isize] = if diagonals { &[0, -1, 1] } else { &[0] };
    let (k, d) = (volume.surfaces, shifts.len());
    let height = luma.len() / width;
    let slot = k + 2;
    let zero = vec![0_u16; slot];
    let mut before = vec![0_u16; width * d * slot];
    let mut after = before.clone();
    let (mut low_before, mut low_after) = (vec![0_u16; width * d], vec![0_u16; width * d]);
    let columns = width.div_ceil(2 * rayon::current_num_threads()).max(16);
    let arch = Arch::new();
    for i in 0..height {
        let y = if upwards { height - 1 - i } else { i };
        let from = if upwards { y + 1 } else { y.wrapping_sub(1) };
        let costs = &volume.costs[y * width * k..(y + 1) * width * k];
        let row = Row { k, shifts, width, y, from, first: i == 0, luma, costs };
        let path = Path { before: &before, lowest: &low_before, zero: &zero };
        after
            .par_chunks_mut(columns * d * slot)
            .zip(low_after.par_chunks_mut(columns * d))
            .zip(sums[y * width * k..(y + 1) * width * k].par_chunks_mut(columns * k))
            .enumerate()
            .for_each(|(chunk, ((after, lowest), sums))| {
                let start = chunk * columns;
                arch.dispatch(PartOfRow { row: &row, path: &path, penalties, start, after, lowest, sums });
            });
        std::mem::swap(&mut before, &mut after);
        std::mem::swap(&mut low_before, &mut low_after);
    }
}

/// One row of the image on the way down or up.
struct Row<'a> {
    k: usize,
    shifts: &'a [isize],
    width: usize,
    y: usize,
    /// The row before.
    from: usize,
    /// Whether there is none before.
    first: bool,
    luma: &'a [f32],
    costs: &'a [u8],
}

/// Path costs of the row before, `[column][direction]`, with their lowest.
struct Path<'a> {
    before: &'a [u16],
    lowest: &'a [u16],
    zero: &'a [u16],
}

/// The columns of a row from `start` on.
struct PartOfRow<'a> {
    row: &'a Row<'a>,
    path: &'a Path<'a>,
    penalties: &'a Penalties,
    start: usize,
    after: &'a mut [u16],
    lowest: &'a mut [u16],
    sums: &'a mut [u16],
}

impl WithSimd for PartOfRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        part_of_row(self);
    }
}

#[inline(always)]
fn part_of_row(part: PartOfRow<'_>) {
    let PartOfRow { row, path, penalties, start, after, lowest, sums } = part;
    let (k, d, width) = (row.k, row.shifts.len(), row.width);
    let slot = k + 2;
    for (c, sums) in sums.chunks_exact_mut(k).enumerate() {
        let x = start + c;
        for (j, &shift) in row.shifts.iter().enumerate() {
            let there = x.checked_add_signed(shift).filter(|&x| x < width && !row.first);
            let (before, low, large) = match there {
                Some(x0) => (
                    &path.before[(x0 * d + j) * slot..(x0 * d + j + 1) * slot],
                    path.lowest[x0 * d + j],
                    penalties.between(row.luma[row.y * width + x], row.luma[row.from * width + x0]),
                ),
                None => (path.zero, 0, penalties.large),
            };
            let costs = &row.costs[x * k..(x + 1) * k];
            let after = &mut after[(c * d + j) * slot..(c * d + j + 1) * slot];
            lowest[c * d + j] = step(costs, before, low, (penalties.small, large), after, sums);
        }
    }
}
