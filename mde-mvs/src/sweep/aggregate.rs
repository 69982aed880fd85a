//! Semi-global matching: costs smoothed along straight paths.
//!
//! Along a direction \\( r \\) the path cost of surface \\( k \\) at pixel \\( p \\) is (Hirschmueller, 2008)
//!
//! \\[ L_r(p, k) = C(p, k) + \min\{ L_r(p-r, k),\; L_r(p-r, k \pm 1) + P_1,\; \min_i L_r(p-r, i) + P_2 \}
//!    - \min_i L_r(p-r, i) . \\]
//!
//! The sum over \\( n \\) directions less \\( (n-1)\,C \\) counts every cost once and approximates a min-marginal (Drory et al., 2014).

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::cost::Volume;

/// Larger than any path cost, and small enough that a penalty may be added.
const FAR: u16 = 1 << 14;
/// Columns from which the paths down and up come: straight, and along both diagonals.
const SHIFTS: [isize; 3] = [0, -1, 1];

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
        sum[k] = sum[k].wrapping_add(path);
        least = least.min(path);
    }
    least
}

/// Sums over 8 directions less the costs counted twice, `[height, width, surfaces]`.
///
/// `luma` has the pixels row after row.
pub(crate) fn aggregate(volume: &Volume, luma: &[f32], width: usize, penalties: &Penalties) -> Vec<u16> {
    let k = volume.surfaces;
    // What is counted twice is taken off first, modulo 2^16: zeroed pages, read before they are written, would each be copied.
    let twice = |&cost: &u8| (7 * u16::from(cost)).wrapping_neg();
    let mut sums: Vec<u16> = volume.costs.par_iter().with_min_len(width * k).map(twice).collect();
    let arch = Arch::new();
    let rows = sums.par_chunks_mut(width * k).zip(volume.costs.par_chunks(width * k));
    rows.zip(luma.par_chunks(width)).for_each(|((sums, costs), luma)| {
        arch.dispatch(AlongRow { costs, luma, k, penalties, sums });
    });
    for upwards in [false, true] {
        across_rows(volume, luma, width, penalties, upwards, &mut sums);
    }
    sums
}

/// Both horizontal directions of one row. Structs and not closures, so that all of it is compiled for the processor's vectors.
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
        let Self { costs, luma, k, penalties, sums } = self;
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
}

/// The vertical and the two diagonal directions, row by row; columns of a row are independent.
fn across_rows(
    volume: &Volume,
    luma: &[f32],
    width: usize,
    penalties: &Penalties,
    upwards: bool,
    sums: &mut [u16],
) {
    let (k, d) = (volume.surfaces, SHIFTS.len());
    let height = luma.len() / width;
    let slot = k + 2;
    let zero = vec![0_u16; slot];
    let mut before = vec![0_u16; width * d * slot];
    let mut after = before.clone();
    let (mut low_before, mut low_after) = (vec![0_u16; width * d], vec![0_u16; width * d]);
    let columns = width.div_ceil(2 * rayon::current_num_threads()).max(16);
    let mut luma_before = None;
    let arch = Arch::new();
    for i in 0..height {
        let y = if upwards { height - 1 - i } else { i };
        let part = y * width..(y + 1) * width;
        let (own, costs) = (&luma[part.clone()], &volume.costs[part.start * k..part.end * k]);
        let row = Row { k, luma: own, luma_before, costs, before: &before, lowest: &low_before, zero: &zero };
        luma_before = Some(own);
        after
            .par_chunks_mut(columns * d * slot)
            .zip(low_after.par_chunks_mut(columns * d))
            .zip(sums[part.start * k..part.end * k].par_chunks_mut(columns * k))
            .enumerate()
            .for_each(|(chunk, ((after, lowest), sums))| {
                let start = chunk * columns;
                arch.dispatch(PartOfRow { row: &row, penalties, start, after, lowest, sums });
            });
        std::mem::swap(&mut before, &mut after);
        std::mem::swap(&mut low_before, &mut low_after);
    }
}

/// One row of the image on the way down or up.
struct Row<'a> {
    k: usize,
    luma: &'a [f32],
    costs: &'a [u8],
    /// Luma of the row before, where there is one.
    luma_before: Option<&'a [f32]>,
    /// Path costs of the row before, `[column][direction]`, their lowest, and those before the first pixel of a path.
    before: &'a [u16],
    lowest: &'a [u16],
    zero: &'a [u16],
}

/// The columns of a row from `start` on.
struct PartOfRow<'a> {
    row: &'a Row<'a>,
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
        let Self { row, penalties, start, after, lowest, sums } = self;
        let (k, d) = (row.k, SHIFTS.len());
        let slot = k + 2;
        for (c, sums) in sums.chunks_exact_mut(k).enumerate() {
            let x = start + c;
            for (j, &shift) in SHIFTS.iter().enumerate() {
                let there = x.checked_add_signed(shift);
                let there = there.and_then(|x0| Some((x0, *row.luma_before?.get(x0)?)));
                let (before, low, large) = match there {
                    Some((x0, luma)) => {
                        let path = x0 * d + j;
                        let large = penalties.between(row.luma[x], luma);
                        (&row.before[path * slot..(path + 1) * slot], row.lowest[path], large)
                    }
                    None => (row.zero, 0, penalties.large),
                };
                let costs = &row.costs[x * k..(x + 1) * k];
                let after = &mut after[(c * d + j) * slot..(c * d + j + 1) * slot];
                lowest[c * d + j] = step(costs, before, low, (penalties.small, large), after, sums);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::random::CounterRng;
    use ndarray::Array2;
    use proptest::prelude::*;
    use rand::RngExt;

    /// The module's equations in `f64`, each path cost from the one before it.
    fn reference(costs: &[u8], luma: &[f32], [h, w, k]: [usize; 3], p: &Penalties) -> Vec<f64> {
        let steps = [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)];
        let cost = |pixel: usize, s: usize| f64::from(costs[pixel * k + s]);
        let mut sums = vec![0.0; h * w * k];
        for &(dy, dx) in &steps {
            let mut paths = vec![Vec::<f64>::new(); h * w];
            // Against the step, so that the pixel before is done.
            let order = |n: usize, d: isize| (0..n).map(move |i| if d < 0 { n - 1 - i } else { i });
            for y in order(h, dy) {
                for x in order(w, dx) {
                    let here = y * w + x;
                    let before =
                        |at: usize, step: isize, n| at.checked_add_signed(-step).filter(|at| *at < n);
                    let from = before(y, dy, h).zip(before(x, dx, w));
                    paths[here] = match from {
                        None => (0..k).map(|s| cost(here, s)).collect(),
                        Some((y0, x0)) => {
                            let before = &paths[y0 * w + x0];
                            let least = before.iter().copied().fold(f64::INFINITY, f64::min);
                            let apart = f64::from((luma[here] - luma[y0 * w + x0]).abs());
                            let large = (f64::from(p.large) / (1.0 + apart / f64::from(p.edge))).floor();
                            let large = large.max(f64::from(p.small) + 1.0);
                            let reached = |s: usize| {
                                let beside =
                                    [s.wrapping_sub(1), s + 1].into_iter().filter_map(|i| before.get(i));
                                let beside = beside.copied().fold(f64::INFINITY, f64::min);
                                before[s].min(beside + f64::from(p.small)).min(least + large)
                            };
                            (0..k).map(|s| cost(here, s) + reached(s) - least).collect()
                        }
                    };
                    let sums = sums[here * k..].iter_mut();
                    sums.zip(&paths[here]).for_each(|(sum, path)| *sum += path);
                }
            }
        }
        let twice = steps.len() as f64 - 1.0;
        sums.iter().zip(costs).map(|(sum, &cost)| sum - twice * f64::from(cost)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        #[test]
        fn the_sums_are_those_of_the_equations(
            h in 1..9_usize, w in 1..40_usize, k in 1..20_usize,
            small in 1..40_u16, more in 1..120_u16, seed: u64,
        ) {
            let mut rng = CounterRng::new(seed, "costs", 0, 0);
            let costs: Vec<u8> = (0..h * w * k).map(|_| rng.random_range(0..255)).collect();
            // Of few values, so that penalties do not lie at a rounding of their division.
            let luma: Vec<f32> = (0..h * w).map(|_| f32::from(rng.random_range(0..4_u8)) / 4.0).collect();
            let penalties = Penalties { small, large: small + more, edge: 0.25 };
            let volume = Volume { costs: costs.clone(), surfaces: k, seen: Array2::from_elem((h, w), true) };
            let found = aggregate(&volume, &luma, w, &penalties);
            let expected = reference(&costs, &luma, [h, w, k], &penalties);
            prop_assert!(found.iter().zip(&expected).all(|(a, b)| f64::from(*a) == *b));
        }
    }
}
