use mde_uncertainty::statistics::median;

/// Standard deviation of a Gaussian with the median of these absolute values: 1.4826 times it.
pub(crate) fn robust_deviation(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    median(residuals.map(f64::abs)).map(|m| 1.4826 * m)
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
