use super::{channels, check, known};
use crate::raster::same_shape;
use crate::{Error, Refined, Result, Task};
use faer::prelude::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Col, Side};
use ndarray::{Array2, ArrayView2, ArrayView3};
use std::collections::HashMap;

/// Sides of a cell of the grid: down and along the image in pixels, Y, U and V.
const SIDES: [f64; 5] = [8.0, 8.0, 4.0, 4.0, 4.0];
/// \\(\lambda\\).
const LAMBDA: f64 = 128.0;
/// Gradient of the log depth, per pixel, that halves the prior's confidence: monocular depth is wrong where it is steep.
const STEEP: f64 = 0.02;
/// Added to the confidence of every vertex, so that those that no confidence reaches have a solution: 0.
const LEAST: f64 = 1e-9;
/// Rounds of the bistochastisation, as published.
const ROUNDS: usize = 10;

/// \\(1 / (1 + (|\nabla \ln D| / s)^2)\\) with \\(s = 0.02\\) and differences of neighbours per pixel, those that are known,
/// `[height, width]`; 0 where the depth is missing.
fn confidence(depth: ArrayView2<'_, f32>) -> Array2<f32> {
    let log = |at: (usize, usize)| depth.get(at).filter(|d| known(**d)).map(|d| f64::from(*d).ln());
    Array2::from_shape_fn(depth.dim(), |(y, x)| {
        let Some(here) = log((y, x)) else { return 0.0 };
        let slope = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) => 0.5 * (after - before),
            (Some(other), None) | (None, Some(other)) => other - here,
            (None, None) => 0.0,
        };
        // Off the map, `wrapping_sub` is no pixel either.
        let down = slope(log((y.wrapping_sub(1), x)), log((y + 1, x)));
        let right = slope(log((y, x.wrapping_sub(1))), log((y, x + 1)));
        (1.0 + (down * down + right * right) / STEEP.powi(2)).recip() as f32
    })
}

/// Solves for a target with any confidence that is not negative, all `[height, width]`; a pixel without confidence takes the
/// target of neighbours of like colour, 0 where there is none.
///
/// # Errors
/// [`Error::Shape`] where the maps differ, [`Error::Value`] for a target (where its confidence is not 0) or
/// confidence that is not finite, [`Error::Method`] where the system cannot be factorised.
pub fn solve_bilateral(
    image: ArrayView3<'_, f32>,
    target: ArrayView2<'_, f32>,
    confidence: ArrayView2<'_, f32>,
) -> Result<Array2<f32>> {
    let (height, width, _) = image.dim();
    same_shape("the target", target.dim(), (height, width))?;
    same_shape("the confidence", confidence.dim(), (height, width))?;
    let sound = |c: f32, t: f32| c == 0.0 || c > 0.0 && c.is_finite() && t.is_finite();
    let mut pixels = confidence.iter().zip(target).enumerate();
    if let Some((index, (c, _))) = pixels.find(|(_, (c, t))| !sound(**c, **t)) {
        let value = f64::from(*c);
        let (what, expected) = ("the confidence", "at least 0, with a finite target");
        return Err(Error::Value { what, index, value, expected });
    }
    let grid = Grid::new(image);
    let size = grid.neighbours.len();
    let weights = confidence.iter().map(|c| f64::from(*c));
    let product = |(&c, &t): (&f32, &f32)| if c > 0.0 { f64::from(c) * f64::from(t) } else { 0.0 };
    let weighted = confidence.iter().zip(target).map(product);
    let (diagonal, right) = (grid.splat(weights), grid.splat(weighted));
    if diagonal.iter().all(|d| *d <= 0.0) {
        return Ok(Array2::zeros((height, width)));
    }
    let (m, n) = grid.bistochastic();
    let mut entries = Vec::new();
    for (row, neighbours) in grid.neighbours.iter().enumerate() {
        let own = LAMBDA * (m[row] - n[row] * Grid::CENTRE * n[row]) + diagonal[row] + LEAST;
        entries.push(Triplet::new(row, row, own));
        for &column in neighbours.iter().filter(|column| (**column as usize) < row) {
            entries.push(Triplet::new(row, column as usize, -LAMBDA * n[row] * n[column as usize]));
        }
    }
    let fault = |what: String| Error::Method(format!("the bilateral solver's system {what}"));
    let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, &entries)
        .map_err(|e| fault(format!("can't be built: {e:?}")))?;
    let factor = matrix.sp_cholesky(Side::Lower).map_err(|e| fault(format!("can't be factorised: {e:?}")))?;
    let solution = factor.solve(&Col::from_fn(size, |row| right[row]));
    Ok(grid.vertex.mapv(|vertex| solution[vertex as usize] as f32))
}

/// Fast bilateral solver (Barron and Poole, ECCV 2016; defaults of the published notebook): the depth \\(x\\) that is smooth where the image
/// is, and near the target \\(t\\) where the confidence \\(c\\) is high,
///
/// \\[ \min_x \tfrac\lambda2 \sum_{ij} \hat W_{ij} (x_i - x_j)^2 + \sum_i c_i (x_i - t_i)^2, \\]
///
/// with \\(\hat W\\) the bistochastic bilateral affinity of place and colour (YUV, 0 to 255). It is solved for the vertices of a
/// bilateral grid, \\((\lambda (D_m - D_n \bar B D_n) + \operatorname{diag}(S c))\\, y = S (c\\, t)\\), by a sparse Cholesky factorisation
/// where the published code takes 25 steps of conjugate gradients.
pub fn fast_bilateral(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let mut depth = solve_bilateral(task.image, task.prior, confidence(task.prior).view())?;
    depth.zip_mut_with(&task.prior, |d, &prior| {
        *d = match known(prior) {
            true if known(*d) => *d,
            true => prior,
            false => 0.0,
        };
    });
    Ok(depth.into())
}

/// The occupied vertices of the bilateral grid of place and colour.
struct Grid {
    /// Vertex of each pixel.
    vertex: Array2<u32>,
    /// Occupied vertices one step away along each of the five axes.
    neighbours: Vec<Vec<u32>>,
}

impl Grid {
    /// Weight of a vertex itself in the blur: 2 for each axis, 1 for each neighbour.
    const CENTRE: f64 = 10.0;

    fn new(image: ArrayView3<'_, f32>) -> Self {
        let (height, width, _) = image.dim();
        let planes = channels(image);
        let mut index: HashMap<[i32; 5], u32> = HashMap::new();
        let mut cells: Vec<[i32; 5]> = Vec::new();
        let vertex = Array2::from_shape_fn((height, width), |(y, x)| {
            let [r, g, b] = [0, 1, 2].map(|channel: usize| 255.0 * f64::from(planes[channel][(y, x)]));
            // BT.601, full range, as JPEG has it.
            let luminance = 0.299 * r + 0.587 * g + 0.114 * b;
            let (u, v) = (128.0 + 0.564 * (b - luminance), 128.0 + 0.713 * (r - luminance));
            let place = [y as f64, x as f64, luminance, u, v];
            let cell = std::array::from_fn(|axis| (place[axis] / SIDES[axis]).floor() as i32);
            let next = cells.len() as u32;
            let id = *index.entry(cell).or_insert(next);
            if id == next {
                cells.push(cell);
            }
            id
        });
        let around = |cell: &[i32; 5]| {
            let step = |axis: usize, by: i32| {
                let mut other = *cell;
                // A colour far out of range lies in the last cell, which has no next one.
                other[axis] = other[axis].checked_add(by)?;
                index.get(&other).copied()
            };
            (0..5).flat_map(|axis| [step(axis, -1), step(axis, 1)]).flatten().collect()
        };
        let neighbours = cells.iter().map(around).collect();
        Self { vertex, neighbours }
    }

    /// Sums of the pixels' values by vertex.
    fn splat(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut sums = vec![0.0; self.neighbours.len()];
        self.vertex.iter().zip(values).for_each(|(&vertex, value)| sums[vertex as usize] += value);
        sums
    }

    fn blur(&self, values: &[f64]) -> Vec<f64> {
        let around = |row: &Vec<u32>| row.iter().map(|&column| values[column as usize]).sum::<f64>();
        self.neighbours.iter().zip(values).map(|(row, own)| Self::CENTRE * own + around(row)).collect()
    }

    /// \\(m\\) and \\(n\\) with \\(n \odot \bar B n = m\\): the affinity's rows sum to one.
    fn bistochastic(&self) -> (Vec<f64>, Vec<f64>) {
        let m = self.splat(std::iter::repeat(1.0));
        let mut n = vec![1.0; m.len()];
        for _ in 0..ROUNDS {
            let blurred = self.blur(&n);
            n = n.iter().zip(&m).zip(&blurred).map(|((n, m), blurred)| (n * m / blurred).sqrt()).collect();
        }
        // With this m the rows are exact however far the rounds came.
        let m = self.blur(&n).iter().zip(&n).map(|(blurred, n)| blurred * n).collect();
        (m, n)
    }
}
