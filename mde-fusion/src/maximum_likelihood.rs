use crate::Residual;
use crate::root::increasing_root;

/// Ratio of neighbouring points of the search grid, and the number of points.
const GRID_RATIO: f64 = 4.0;
const GRID_POINTS: i32 = 20;

/// Maximum-likelihood estimate of the prior's variance under Eq. 14.
///
/// The \\(s \ge 0\\) that maximises
///
/// \\[ \ell(s) = -\frac12 \sum_{x\in\mathcal X} \left[ \ln\bigl(s + c(x)\bigr) + \frac{\delta(x)^2}{s + c(x)} \right],
/// \qquad c = a^2 (\sigma_r^2)^{\mathrm{agg}}, \\]
///
/// a root of the [score](likelihood_score) or 0. The likelihood may have several peaks: a coarse grid finds the
/// highest, a bracketed root search its top.
pub fn maximum_likelihood(residuals: &[Residual]) -> f64 {
    let largest = residuals.iter().map(|r| r.delta * r.delta).fold(0.0, f64::max);
    if largest <= 0.0 {
        return 0.0;
    }
    // The score is negative from the largest squared residual on, so the peak lies in [0, largest].
    let grid: Vec<f64> =
        std::iter::once(0.0).chain((0..GRID_POINTS).rev().map(|i| largest * GRID_RATIO.powi(-i))).collect();
    let height = grid.iter().map(|&s| log_likelihood(residuals, s)).enumerate();
    let Some((best, _)) = height.max_by(|a, b| a.1.total_cmp(&b.1)) else { return 0.0 };
    let point = |i: usize| grid.get(i).copied().unwrap_or(largest);
    let (score, _) = score_and_slope(residuals, point(best));
    // Uphill from the best point, the next one is no higher: a peak lies between.
    let (low, high) = match best {
        _ if score > 0.0 => (point(best), point(best + 1)),
        0 => return 0.0,
        _ => (point(best - 1), point(best)),
    };
    let downhill = |t: f64| {
        let (score, slope) = score_and_slope(residuals, low + t);
        (-score, -slope)
    };
    low + increasing_root(downhill, high - low)
}

/// Twice the derivative of the log-likelihood of Eq. 14 in \\(s = \sigma_o^2\\), negated as it is usually set to 0:
///
/// \\[ \sum_{x\in\mathcal X} \left[ \frac{1}{s + c(x)} - \frac{\delta(x)^2}{(s + c(x))^2} \right] = 0 \\]
pub fn likelihood_score(residuals: &[Residual], s: f64) -> f64 {
    -score_and_slope(residuals, s).0
}

/// \\(2\ell'(s)\\) and \\(2\ell''(s)\\).
fn score_and_slope(residuals: &[Residual], s: f64) -> (f64, f64) {
    let (mut score, mut slope) = (0.0, 0.0);
    for r in residuals {
        let w = (s + r.variance).recip();
        let z2 = r.delta * r.delta * w;
        score += w * (z2 - 1.0);
        slope += w * w * (1.0 - 2.0 * z2);
    }
    (score, slope)
}

/// \\(2\ell(s)\\) up to a constant; what is no number counts as lowest.
fn log_likelihood(residuals: &[Residual], s: f64) -> f64 {
    let term = |r: &Residual| {
        let total = s + r.variance;
        -(total.ln() + r.delta * r.delta / total)
    };
    let sum: f64 = residuals.iter().map(term).sum();
    if sum.is_nan() { f64::NEG_INFINITY } else { sum }
}
