use crate::scalar::Scalar;
use mde_warp::random::CounterRng;
use rand::RngExt;

/// The most features a row may have.
pub(crate) const MAX_FEATURES: usize = 8;

/// The shape of a multiresolution hash grid (Müller et al., 2022).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HashLayout {
    features: usize,
    levels: Vec<Level>,
}

/// One grid: `cells` along each axis, its `(cells + 1)^3` corners in `rows` rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Level {
    cells: u32,
    first_row: usize,
    rows: usize,
    /// Every corner has a row of its own.
    dense: bool,
}

/// The grid's table: `features` numbers a row, the rows level by level.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HashGrid<T> {
    pub(crate) layout: HashLayout,
    pub(crate) table: Vec<T>,
}

impl HashLayout {
    /// `levels` grids from `coarsest` to `finest` cells a side in geometric steps, at most `2^log2_rows` rows each.
    pub(crate) fn new(levels: usize, features: usize, log2_rows: u32, coarsest: u32, finest: u32) -> Self {
        let growth = if levels > 1 {
            (f64::from(finest) / f64::from(coarsest)).powf(1.0 / (levels - 1) as f64)
        } else {
            1.0
        };
        let mut first_row = 0;
        let levels = (0..levels)
            .map(|level| {
                // The small addend keeps the last level at `finest` where the power rounds down.
                let cells = (f64::from(coarsest) * growth.powi(level as i32) + 1e-6).floor() as u32;
                let corners = (u64::from(cells) + 1).pow(3);
                let dense = corners <= 1 << log2_rows;
                let rows = if dense { corners as usize } else { 1 << log2_rows };
                let level = Level { cells, first_row, rows, dense };
                first_row += rows;
                level
            })
            .collect();
        Self { features, levels }
    }

    pub(crate) fn level_count(&self) -> usize {
        self.levels.len()
    }

    pub(crate) fn features(&self) -> usize {
        self.features
    }

    /// Features of a point, all levels together.
    #[cfg(test)]
    pub(crate) fn width(&self) -> usize {
        self.features * self.levels.len()
    }

    /// Numbers in the table.
    pub(crate) fn table_len(&self) -> usize {
        self.levels.iter().map(|l| l.rows * self.features).sum()
    }

    /// A mutable slice a level of a vector that is laid out like the table.
    pub(crate) fn split_levels<'t, T>(&self, mut table: &'t mut [T]) -> Vec<&'t mut [T]> {
        self.levels
            .iter()
            .map(|level| {
                let (head, tail) = std::mem::take(&mut table).split_at_mut(level.rows * self.features);
                table = tail;
                head
            })
            .collect()
    }

    /// Adds `d_features` (`[points, features]` of one level) to that level's rows of the table's gradient.
    pub(crate) fn scatter<T: Scalar>(
        &self,
        level: usize,
        points: &[[T; 3]],
        d_features: &[T],
        gradient: &mut [T],
    ) {
        match self.features {
            1 => scatter::<T, 1>(&self.levels[level], points, d_features, gradient),
            2 => scatter::<T, 2>(&self.levels[level], points, d_features, gradient),
            4 => scatter::<T, 4>(&self.levels[level], points, d_features, gradient),
            _ => scatter::<T, MAX_FEATURES>(&self.levels[level], points, d_features, gradient),
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

    /// Features of `points` (in the unit cube), one row of `stride` each, level by level, padded with zeros.
    ///
    /// Per level the trilinear mean of the cell's eight corner rows.
    pub(crate) fn forward(&self, points: &[[T; 3]], features: &mut Vec<T>, stride: usize) {
        features.clear();
        features.resize(points.len() * stride, T::ZERO);
        match self.layout.features {
            1 => self.gather::<1>(points, features, stride),
            2 => self.gather::<2>(points, features, stride),
            4 => self.gather::<4>(points, features, stride),
            _ => self.gather::<MAX_FEATURES>(points, features, stride),
        }
    }

    fn gather<const F: usize>(&self, points: &[[T; 3]], features: &mut [T], stride: usize) {
        T::vectorized(
            #[inline(always)]
            || {
                for (index, level) in self.layout.levels.iter().enumerate() {
                    let (rows, _) = self.table[level.first_row * F..][..level.rows * F].as_chunks::<F>();
                    for (point, out) in points.iter().zip(features.chunks_exact_mut(stride)) {
                        let (corners, weights) = level.corners(point);
                        let mut sum = [T::ZERO; F];
                        for (corner, weight) in corners.into_iter().zip(weights) {
                            let row = &rows[corner as usize];
                            for f in 0..F {
                                sum[f] += weight * row[f];
                            }
                        }
                        out[index * F..(index + 1) * F].copy_from_slice(&sum);
                    }
                }
            },
        );
    }
}

fn scatter<T: Scalar, const F: usize>(
    level: &Level,
    points: &[[T; 3]],
    d_features: &[T],
    gradient: &mut [T],
) {
    T::vectorized(
        #[inline(always)]
        || {
            let (rows, _) = gradient.as_chunks_mut::<F>();
            for (point, d) in points.iter().zip(d_features.as_chunks::<F>().0) {
                if d.iter().all(|&d| d == T::ZERO) {
                    continue;
                }
                let (corners, weights) = level.corners(point);
                for (corner, weight) in corners.into_iter().zip(weights) {
                    let row = &mut rows[corner as usize];
                    for f in 0..F {
                        row[f] += weight * d[f];
                    }
                }
            }
        },
    );
}

impl Level {
    /// Rows and trilinear weights of the corners around a point of the unit cube.
    ///
    /// The third axis (depth) runs fastest, so neighbouring samples of a ray share cache lines.
    #[inline(always)]
    fn corners<T: Scalar>(&self, point: &[T; 3]) -> ([u32; 8], [T; 8]) {
        let mut low = [0_u32; 3];
        let mut fraction = [T::ZERO; 3];
        for axis in 0..3 {
            let x = point[axis].max(T::ZERO).min(T::ONE) * T::from_index(self.cells);
            low[axis] = x.to_index().min(self.cells - 1);
            fraction[axis] = x - T::from_index(low[axis]);
        }
        let [u, v, s] = low;
        let (u_step, v_step) = if self.dense {
            (self.cells + 1, (self.cells + 1) * (self.cells + 1))
        } else {
            (2_654_435_761, 805_459_861)
        };
        let us = [u.wrapping_mul(u_step), (u + 1).wrapping_mul(u_step)];
        let vs = [v.wrapping_mul(v_step), (v + 1).wrapping_mul(v_step)];
        let wu = [T::ONE - fraction[0], fraction[0]];
        let wv = [T::ONE - fraction[1], fraction[1]];
        let ws = [T::ONE - fraction[2], fraction[2]];
        let mut rows = [0; 8];
        let mut weights = [T::ZERO; 8];
        for corner in 0..8_usize {
            let [i, j, k] = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let depth = s + k as u32;
            rows[corner] = if self.dense {
                vs[i] + us[j] + depth
            } else {
                (vs[i] ^ us[j] ^ depth) & (self.rows as u32 - 1)
            };
            weights[corner] = wv[i] * wu[j] * ws[k];
        }
        (rows, weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn layout() -> HashLayout {
        HashLayout::new(4, 2, 9, 4, 32)
    }

    fn cube() -> impl Strategy<Value = [f64; 3]> {
        [0.0..=1.0_f64, 0.0..=1.0_f64, 0.0..=1.0_f64]
    }

    proptest! {
        #[test]
        fn corner_weights_add_up_to_one_and_rows_exist(point in cube()) {
            for level in &layout().levels {
                let (rows, weights) = level.corners(&point);
                prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                prop_assert!(rows.iter().all(|&r| (r as usize) < level.rows));
            }
        }

        /// Dense levels hold one row a corner: a table filled with a linear function is interpolated exactly.
        #[test]
        fn a_dense_level_reproduces_linear_functions(point in cube(), slope in [-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64]) {
            let layout = HashLayout::new(1, 1, 12, 8, 8);
            let linear = |p: [f64; 3]| p.iter().zip(slope).map(|(p, s)| p * s).sum::<f64>();
            let n = 9;
            let table = (0..n * n * n)
                .map(|row| linear([row / n % n, row / n / n, row % n].map(|i| i as f64 / 8.0)))
                .collect();
            let grid = HashGrid { layout, table };
            let mut features = Vec::new();
            grid.forward(&[point], &mut features, 1);
            prop_assert!((features[0] - linear(point)).abs() < 1e-12);
        }

        /// The scatter is the transpose of the gather: <gather(t), d> = <t, scatter(d)>.
        #[test]
        fn scatter_is_the_transpose_of_gather(points in proptest::collection::vec(cube(), 1..20), seed: u64) {
            let layout = layout();
            let mut grid = HashGrid::<f64>::new(layout.clone(), seed);
            grid.table.iter_mut().for_each(|t| *t *= 1e4);
            let stride = 16;
            let mut features = Vec::new();
            grid.forward(&points, &mut features, stride);
            let mut rng = CounterRng::new(seed, "d", 0, 0);
            let d: Vec<f64> = (0..points.len() * layout.width()).map(|_| rng.random()).collect();
            let forward: f64 = (0..points.len())
                .flat_map(|p| (0..layout.width()).map(move |f| (p, f)))
                .map(|(p, f)| features[p * stride + f] * d[p * layout.width() + f])
                .sum();
            let mut gradient = vec![0.0; layout.table_len()];
            for (level, rows) in layout.split_levels(&mut gradient).into_iter().enumerate() {
                let of_level: Vec<f64> = d
                    .chunks_exact(layout.width())
                    .flat_map(|row| row[level * 2..level * 2 + 2].to_vec())
                    .collect();
                layout.scatter(level, &points, &of_level, rows);
            }
            let backward: f64 = gradient.iter().zip(&grid.table).map(|(g, t)| g * t).sum();
            prop_assert!((forward - backward).abs() < 1e-9 * (1.0 + forward.abs()));
        }
    }

    #[test]
    fn levels_run_from_coarsest_to_finest() {
        let layout = HashLayout::new(8, 4, 16, 16, 640);
        assert_eq!(layout.levels.first().map(|l| (l.cells, l.dense)), Some((16, true)));
        assert_eq!(layout.levels.last().map(|l| (l.cells, l.dense)), Some((640, false)));
        assert_eq!(layout.width(), 32);
    }
}
