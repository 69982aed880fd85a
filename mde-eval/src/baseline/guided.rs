use super::{channels, check, known, weights};
use crate::metrics::sparsification::running_sums;
use crate::raster::mean_of;
use crate::{Refined, Result, Task};
use nalgebra::{Matrix3, Vector3};
use ndarray::{Array2, Axis};

/// Half the window's side without its middle, pixels.
const RADIUS: usize = 12;
/// \\(\epsilon\\), in squared colour (0 to 1).
const EPSILON: f64 = 1e-3;

/// Guided filter with a colour guide (He, Sun and Tang, PAMI 2013): within each window the depth is an affine function of colour,
///
/// \\[ d \approx a^\top I + b,\qquad a = (\Sigma_I + \epsilon \mathbf 1)^{-1} \operatorname{cov}(I, d),\qquad b = \bar d - a^\top \bar I, \\]
///
/// and each pixel takes the mean of \\(a\\) and \\(b\\) over the windows that hold it. Linear in the pixels whatever the radius.
pub fn guided_filter(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let weights = weights(task.prior);
    let depth = task.prior.mapv(|d| if known(d) { f64::from(d) } else { 0.0 });
    let colour = channels(task.image).map(|plane| plane.mapv(f64::from));
    let count = box_sums(weights.clone(), RADIUS);
    // Means over the known pixels of each window.
    let mean = |map: Array2<f64>| mean_of(box_sums(map * &weights, RADIUS), &count);
    let mean_depth = mean(depth.clone());
    let mean_colour: [Array2<f64>; 3] = std::array::from_fn(|i| mean(colour[i].clone()));
    let cross: [Array2<f64>; 3] = std::array::from_fn(|i| mean(&colour[i] * &depth));
    let squares = PAIRS.map(|(i, j)| mean(&colour[i] * &colour[j]));
    let mut lines: [Array2<f64>; 4] = std::array::from_fn(|_| Array2::zeros(depth.dim()));
    for at in ndarray::indices(depth.dim()) {
        let colour = Vector3::from_fn(|i, _| mean_colour[i][at]);
        let mut matrix = Matrix3::from_diagonal_element(EPSILON);
        for (k, &(i, j)) in PAIRS.iter().enumerate() {
            let covariance = squares[k][at] - colour[i] * colour[j];
            matrix[(i, j)] += covariance;
            if i != j {
                matrix[(j, i)] += covariance;
            }
        }
        let covariance = Vector3::from_fn(|i, _| cross[i][at] - colour[i] * mean_depth[at]);
        let slope = matrix.cholesky().map_or_else(Vector3::zeros, |factor| factor.solve(&covariance));
        (0..3).for_each(|i| lines[i][at] = slope[i]);
        lines[3][at] = mean_depth[at] - slope.dot(&colour);
    }
    let lines = lines.map(mean);
    let filtered = Array2::from_shape_fn(depth.dim(), |at| {
        let value = (0..3).map(|i| lines[i][at] * colour[i][at]).sum::<f64>() + lines[3][at];
        // A line may run below the camera; the prior's depth stands there.
        match known(task.prior[at]) {
            true if value > 0.0 && value.is_finite() => value as f32,
            true => task.prior[at],
            false => 0.0,
        }
    });
    Ok(filtered.into())
}

/// Entries of a symmetric 3 x 3 matrix.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Sums over a square of side `2 * radius + 1` about each pixel, cut off at the border; linear in the pixels.
fn box_sums(mut map: Array2<f64>, radius: usize) -> Array2<f64> {
    for axis in [Axis(1), Axis(0)] {
        for mut line in map.lanes_mut(axis) {
            let (running, n) = (running_sums(&line), line.len());
            for (x, out) in line.iter_mut().enumerate() {
                *out = running[(x + radius + 1).min(n)] - running[x.saturating_sub(radius)];
            }
        }
    }
    map
}
