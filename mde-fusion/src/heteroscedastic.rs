use crate::Residual;
use crate::nnls::nnls3;
use ndarray::{Array2, ArrayView2};

/// A prior variance that differs from pixel to pixel.
///
/// \\[ \sigma_o^2(x) = c_0 + c_1 |\nabla D_o(x)|^2 + c_2 D_o(x)^4,\qquad c \ge 0 \\]
///
/// A constant, an error of localisation, which matters where the depth changes, and a constant error of disparity,
/// which grows with the square of the depth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Heteroscedastic {
    /// \\(c_0\\), in the unit of a variance.
    pub(crate) constant: f64,
    /// \\(c_1\\), in pixels squared.
    pub(crate) gradient: f64,
    /// \\(c_2\\), in the unit of an inverse variance.
    pub(crate) disparity: f64,
}

impl Heteroscedastic {
    /// \\(\sigma_o^2(x)\\) at a pixel of prior depth `depth` and squared gradient `gradient2`.
    pub(crate) fn variance(&self, depth: f64, gradient2: f64) -> f64 {
        self.constant + self.gradient * gradient2 + self.disparity * depth.powi(4)
    }

    /// Non-negative least squares of Eq. 15's summand on the three terms,
    ///
    /// \\[ \min_{c \ge 0} \sum_{x\in\mathcal X}
    /// \left( \delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x) - \sigma_o^2(x) \right)^2 . \\]
    ///
    /// With the constant alone this is Eq. 15. Each item is a residual with the pixel's prior depth and squared
    /// [gradient](squared_gradient). All coefficients are 0 where the views' own variance explains the residuals.
    pub(crate) fn fit<'a>(pixels: impl Iterator<Item = (&'a Residual, f64, f64)> + Clone) -> Self {
        // Unit scales keep the fourth powers and their squares in range.
        let scale = |f: &dyn Fn(f64, f64) -> f64| {
            let largest = pixels.clone().map(|(_, depth, gradient2)| f(depth, gradient2)).fold(0.0, f64::max);
            if largest > 0.0 && largest.is_finite() { largest } else { 1.0 }
        };
        let scales = [1.0, scale(&|_, g| g), scale(&|d, _| d.powi(4))];
        let excess = |r: &Residual| r.delta * r.delta - r.variance;
        let unit = pixels.clone().map(|(r, ..)| excess(r).abs()).fold(0.0, f64::max);
        if unit <= 0.0 || !unit.is_finite() {
            return Self::default();
        }
        let mut gram = [[0.0; 3]; 3];
        let mut rhs = [0.0; 3];
        for (r, depth, gradient2) in pixels {
            let row = [1.0, gradient2 / scales[1], depth.powi(4) / scales[2]];
            let y = excess(r) / unit;
            for i in 0..3 {
                rhs[i] += row[i] * y;
                for j in i..3 {
                    gram[i][j] += row[i] * row[j];
                }
            }
        }
        let [constant, gradient, disparity] = nnls3(&gram, rhs);
        Self {
            constant: constant * unit,
            gradient: gradient * unit / scales[1],
            disparity: disparity * unit / scales[2],
        }
    }
}

/// Squared length of the gradient of a map `[height, width]`, per pixel squared.
///
/// Central differences, one-sided beside the frame or a missing (0) neighbour, 0 in a direction that has no neighbour
/// and where the pixel itself is missing.
pub(crate) fn squared_gradient(map: ArrayView2<'_, f64>) -> Array2<f64> {
    let at = |row: Option<usize>, column: Option<usize>| {
        map.get((row?, column?)).copied().filter(|&value| value > 0.0)
    };
    Array2::from_shape_fn(map.dim(), |(r, c)| {
        let Some(here) = at(Some(r), Some(c)) else { return 0.0 };
        let along = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) => 0.5 * (after - before),
            (Some(before), None) => here - before,
            (None, Some(after)) => after - here,
            (None, None) => 0.0,
        };
        let x = along(at(Some(r), c.checked_sub(1)), at(Some(r), Some(c + 1)));
        let y = along(at(r.checked_sub(1), Some(c)), at(Some(r + 1), Some(c)));
        x * x + y * y
    })
}
