use mde_uncertainty::statistics::median;

/// Standard deviation of a Gaussian with the median of these absolute values: 1.4826 times it.
pub(crate) fn robust_deviation(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    median(residuals.map(f64::abs)).map(|m| 1.4826 * m)
}

/// Whether all logarithms of a depth are the same, but for rounding.
pub(crate) fn is_flat(mut logs: impl Iterator<Item = f64>) -> bool {
    logs.next().is_none_or(|first| logs.all(|log| (log - first).abs() < 1e-5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deviation_is_that_of_a_gaussian() {
        assert_eq!(robust_deviation([-1.0, 2.0, -3.0].into_iter()), Some(2.0 * 1.4826));
        assert_eq!(robust_deviation(std::iter::empty()), None);
    }
}
