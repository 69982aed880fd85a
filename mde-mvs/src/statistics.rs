/// The `share`-quantile, linear between order statistics; nothing without values. Reorders `values`.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    mde_uncertainty::statistics::quantile(values, share)
}

/// Standard deviation of a Gaussian with the median of these absolute values: 1.4826 times it.
pub(crate) fn robust_deviation(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    let mut absolute: Vec<f64> = residuals.map(f64::abs).collect();
    quantile(&mut absolute, 0.5).map(|m| 1.4826 * m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_order_statistics() {
        assert_eq!(quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5), Some(2.5));
        assert_eq!(quantile(&mut [], 0.5), None);
    }
}
