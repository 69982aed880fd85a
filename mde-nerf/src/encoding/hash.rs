use crate::config::HashFieldConfig;
use crate::points::{BLOCK, Points};
use crate::scalar::{Scalar, vectorized};
use mde_uncertainty::random::CounterRng;
use rand::RngExt;

/// The shape of a multiresolution hash grid after Müller et al. (2022).
///
/// Columns of corners are hashed, not single corners: the depth axis is contiguous from the row of the hash of
/// \\((u, v)\\), so that one load fetches both corners of a cell edge along depth.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HashLayout {
    /// Numbers per row.
    pub(crate) features: usize,
    levels: Vec<Level>,
}

/// One grid: `cells` along each axis, its `(cells + 1)^3` corners in `rows` rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Level {
    cells: u32,
    first_row: usize,
    rows: usize,
    /// Every corner has its own row.
    dense: bool,
    /// Hashed columns begin at one of the first `mask + 1` rows.
    mask: u32,
}

/// The cells around a block of points.
struct Cells<T> {
    /// Per corner of the \\((u, v)\\) square: the row of the nearer end of its edge along depth.
    rows: [[u32; BLOCK]; 4],
    /// Bilinear weights of those corners.
    weights: [[T; BLOCK]; 4],
    /// Position of the point on that edge, 0 to 1.
    depth: [T; BLOCK],
}

/// The grid's table: `features` numbers per row, the rows level by level.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HashGrid<T> {
    pub(crate) layout: HashLayout,
    pub(crate) table: Vec<T>,
}

impl HashLayout {
    /// Grids from `coarsest` to `finest` cells a side in geometric steps. A grid of more than `2^log2_rows` corners hashes its
    /// columns to as many starts.
    pub(crate) fn new(config: &HashFieldConfig) -> Self {
        let HashFieldConfig { levels, features, log2_rows, coarsest, finest, .. } = *config;
        // Of a single level it has the power 0.
        let growth = (f64::from(finest) / f64::from(coarsest)).powf(1.0 / (levels.max(2) - 1) as f64);
        let mut first_row = 0;
        let levels = (0..levels)
            .map(|level| {
                // The small addend keeps the last level at `finest` where the power rounds down.
                let cells = (f64::from(coarsest) * growth.powi(level as i32) + 1e-6).floor() as u32;
                let corners = (u64::from(cells) + 1).pow(3);
                let starts = 1_u32 << log2_rows;
                let dense = corners <= u64::from(starts);
                // Room for all corners of the last column.
                let rows = if dense { corners as usize } else { starts as usize + cells as usize };
                let level = Level { cells, first_row, rows, dense, mask: starts - 1 };
                first_row += rows;
                level
            })
            .collect();
        Self { features, levels }
    }

    pub(crate) fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// Rows of the table.
    pub(crate) fn rows(&self) -> usize {
        self.levels.iter().map(|l| l.rows).sum()
    }

    /// Numbers in the table.
    pub(crate) fn table_len(&self) -> usize {
        self.rows() * self.features
    }

    /// Numbers of the largest level.
    pub(crate) fn largest_level(&self) -> usize {
        self.levels.iter().map(|l| l.rows * self.features).max().unwrap_or(0)
    }

    /// Mutable slices per level of a vector with `width` entries per row of the table.
    pub(crate) fn split<'t, T>(&self, mut all: &'t mut [T], width: usize) -> Vec<&'t mut [T]> {
        self.levels
            .iter()
            .map(|level| {
                let (head, tail) = std::mem::take(&mut all).split_at_mut(level.rows * width);
                all = tail;
                head
            })
            .collect()
    }

    /// Adds `d_features` (`[points, features]` of one level) to that level's rows of the table's gradient.
    pub(crate) fn scatter<T: Scalar>(
        &self,
        level: usize,
        points: &Points<T>,
        d_features: &[T],
        gradient: &mut [T],
    ) {
        let level = &self.levels[level];
        match self.features {
            1 => level.scatter::<T, 1>(points, d_features, gradient),
            2 => level.scatter::<T, 2>(points, d_features, gradient),
            4 => level.scatter::<T, 4>(points, d_features, gradient),
            _ => level.scatter::<T, 8>(points, d_features, gradient),
        }
    }
}

impl<T: Scalar> HashGrid<T> {
    /// Rows drawn uniformly from ±1e-4, as in the reference implementation.
    pub(crate) fn new(layout: HashLayout, seed: u64) -> Self {
        let mut rng = CounterRng::new(seed, "hash-table", 0, 0);
        let table =
            (0..layout.table_len()).map(|_| T::from_f64(2e-4 * (rng.random::<f64>() - 0.5))).collect();
        Self { layout, table }
    }

    /// Features of `points`, one row of `stride` each, level by level; other columns are not written.
    ///
    /// Per level the trilinear mean of the cell's eight corner rows.
    pub(crate) fn forward(&self, points: &Points<T>, features: &mut [T], stride: usize) {
        match self.layout.features {
            1 => self.gather::<1>(points, features, stride),
            2 => self.gather::<2>(points, features, stride),
            4 => self.gather::<4>(points, features, stride),
            _ => self.gather::<8>(points, features, stride),
        }
    }

    fn gather<const F: usize>(&self, points: &Points<T>, features: &mut [T], stride: usize) {
        vectorized!(T, || {
            // Level by level, so that only one level's rows are in the cache at a time.
            for (index, level) in self.layout.levels.iter().enumerate() {
                let table = &self.table[level.first_row * F..][..level.rows * F];
                for (block, out) in points.blocks().zip(features.chunks_exact_mut(BLOCK * stride)) {
                    let cells = level.cells(block);
                    for (lane, out) in out.chunks_exact_mut(stride).enumerate() {
                        // Of both ends of an edge.
                        let mut sums = [[T::ZERO; F]; 2];
                        for corner in 0..4 {
                            let weight = cells.weights[corner][lane];
                            let rows = &table[cells.rows[corner][lane] as usize * F..][..2 * F];
                            for (sum, &x) in sums.as_flattened_mut().iter_mut().zip(rows) {
                                *sum = weight.mul_add(x, *sum);
                            }
                        }
                        let depth = cells.depth[lane];
                        let [near, far] = sums;
                        for ((out, near), far) in out[index * F..][..F].iter_mut().zip(near).zip(far) {
                            *out = depth.mul_add(far - near, near);
                        }
                    }
                }
            }
        });
    }
}

impl Level {
    fn scatter<T: Scalar, const F: usize>(&self, points: &Points<T>, d_features: &[T], gradient: &mut [T]) {
        vectorized!(T, || {
            let d_blocks = d_features.chunks_exact(BLOCK * F);
            for (block, d) in points.blocks().zip(d_blocks) {
                let cells = self.cells(block);
                for (lane, d) in d.as_chunks::<F>().0.iter().enumerate() {
                    if d.iter().all(|&d| d == T::ZERO) {
                        continue;
                    }
                    let depth = cells.depth[lane];
                    let far = d.map(|d| depth * d);
                    let edge: [[T; F]; 2] = [std::array::from_fn(|f| d[f] - far[f]), far];
                    for corner in 0..4 {
                        let weight = cells.weights[corner][lane];
                        let rows = &mut gradient[cells.rows[corner][lane] as usize * F..][..2 * F];
                        for (sum, &d) in rows.iter_mut().zip(edge.as_flattened()) {
                            *sum = weight.mul_add(d, *sum);
                        }
                    }
                }
            }
        });
    }

    #[inline(always)]
    fn cells<T: Scalar>(&self, block: [&[T; BLOCK]; 3]) -> Cells<T> {
        if self.dense { self.cells_of::<T, true>(block) } else { self.cells_of::<T, false>(block) }
    }

    #[inline(always)]
    fn cells_of<T: Scalar, const DENSE: bool>(&self, block: [&[T; BLOCK]; 3]) -> Cells<T> {
        let corners = self.cells + 1;
        let (u_step, v_step) =
            if DENSE { (corners, corners * corners) } else { (2_654_435_761, 805_459_861) };
        let scale = T::from_index(self.cells);
        let mut cells =
            Cells { rows: [[0; BLOCK]; 4], weights: [[T::ZERO; BLOCK]; 4], depth: [T::ZERO; BLOCK] };
        let points = block[0].iter().zip(block[1]).zip(block[2]);
        for (lane, ((&u, &v), &s)) in points.enumerate() {
            let mut low = [0_u32; 3];
            let mut fraction = [u, v, s];
            for (low, x) in low.iter_mut().zip(&mut fraction) {
                *x = x.max(T::ZERO).min(T::ONE) * scale;
                *low = x.to_index().min(self.cells - 1);
                *x = *x - T::from_index(*low);
            }
            cells.depth[lane] = fraction[2];
            let (u, v) = (low[0].wrapping_mul(u_step), low[1].wrapping_mul(v_step));
            let (us, vs) = ([u, u.wrapping_add(u_step)], [v, v.wrapping_add(v_step)]);
            let (wu, wv) = ([T::ONE - fraction[0], fraction[0]], [T::ONE - fraction[1], fraction[1]]);
            for corner in 0..4 {
                let (i, j) = (corner >> 1, corner & 1);
                let start = if DENSE { vs[i] + us[j] } else { (vs[i] ^ us[j]) & self.mask };
                cells.rows[corner][lane] = start + low[2];
                cells.weights[corner][lane] = wv[i] * wu[j];
            }
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn layout() -> HashLayout {
        let config = HashFieldConfig {
            levels: 4,
            features: 2,
            log2_rows: 9,
            coarsest: 4,
            finest: 32,
            ..Default::default()
        };
        HashLayout::new(&config)
    }

    fn padded<T: Scalar>(point: [f64; 3]) -> Points<T> {
        let mut list = Points::default();
        list.push(point.map(T::from_f64));
        list.pad();
        list
    }

    fn cube() -> impl Strategy<Value = [f64; 3]> {
        [0.0..=1.0_f64, 0.0..=1.0_f64, 0.0..=1.0_f64]
    }

    proptest! {
        #[test]
        fn corner_weights_add_up_to_one_and_rows_exist(point in cube()) {
            for level in &layout().levels {
                let single = level.cells(padded::<f32>(point).blocks().next().unwrap());
                prop_assert!((0.0..=1.0).contains(&single.depth[0]) && (single.rows[0][0] as usize) < level.rows - 1);
                let cells = level.cells(padded::<f64>(point).blocks().next().unwrap());
                prop_assert!((cells.weights.iter().map(|w| w[0]).sum::<f64>() - 1.0).abs() < 1e-12);
                prop_assert!((0.0..=1.0).contains(&cells.depth[0]));
                prop_assert!(cells.rows.iter().all(|r| (r[0] as usize) + 1 < level.rows));
            }
        }

        /// Dense levels have one row per corner: a table filled with a linear function is interpolated exactly.
        #[test]
        fn a_dense_level_reproduces_linear_functions(point in cube(), slope in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64]) {
            let config = HashFieldConfig { levels: 1, features: 1, coarsest: 8, finest: 8, ..Default::default() };
            let layout = HashLayout::new(&config);
            let linear = |p: [f64; 3]| p.iter().zip(slope).map(|(p, s)| p * s).sum::<f64>();
            let n = 9;
            let table = (0..n * n * n)
                .map(|row| linear([row / n % n, row / n / n, row % n].map(|i| i as f64 / 8.0)))
                .collect();
            let grid = HashGrid { layout, table };
            let mut features = vec![0.0; BLOCK];
            grid.forward(&padded::<f64>(point), &mut features, 1);
            prop_assert!((features[0] - linear(point)).abs() < 1e-12);
        }
    }

    /// Cells that share a corner share its row, hashed or not: the field is continuous.
    #[test]
    fn the_features_are_continuous_across_cells() {
        let layout = layout();
        let width = layout.features * layout.level_count();
        let mut grid = HashGrid::<f64>::new(layout.clone(), 3);
        grid.table.iter_mut().for_each(|t| *t *= 1e4);
        for level in &layout.levels {
            let wall = f64::from(level.cells / 2) / f64::from(level.cells);
            for axis in 0..3 {
                let beside = |offset: f64| {
                    let mut point = [0.37, 0.61, 0.23];
                    point[axis] = wall + offset;
                    let mut features = vec![0.0; BLOCK * width];
                    grid.forward(&padded(point), &mut features, width);
                    features.truncate(width);
                    features
                };
                for (a, b) in beside(-1e-9).iter().zip(beside(1e-9)) {
                    assert!((a - b).abs() < 1e-6, "axis {axis}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn levels_run_from_coarsest_to_finest() {
        let layout = HashLayout::new(&HashFieldConfig::default());
        assert_eq!(layout.levels.first().map(|l| (l.cells, l.dense)), Some((16, true)));
        assert_eq!(layout.levels.last().map(|l| (l.cells, l.dense)), Some((640, false)));
        assert_eq!((layout.level_count(), layout.features), (8, 4));
    }
}
