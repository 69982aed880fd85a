use mde_uncertainty::statistics::median;

/// Standard deviation of a Gaussian with the median of these absolute values: 1.4826 times it.
pub(crate) fn robust_deviation(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    median(residuals.map(f64::abs)).map(|m| 1.4826 * m)
}

/// Whether all logarithms of a depth are the same, but for rounding.
pub(crate) fn is_flat(mut logs: impl Iterator<Item = f64>) -> bool {
    logs.next().is_none_or(|first| logs.all(|log| (log - first).abs() < 1e-5))
}
