use mde_uncertainty::statistics::median;

/// The value at which the running weight reaches `share` of the total; nothing without weight. Reorders `values`.
pub(crate) fn weighted_quantile(values: &mut [(f32, f32)], share: f32) -> Option<f32> {
    let total: f32 = values.iter().map(|v| v.1).sum();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut running = 0.0;
    for &(value, weight) in values.iter() {
        running += weight;
        if running >= share * total {
            return Some(value);
        }
    }
    values.last().map(|v| v.0)
}

/// Standard deviation of a Gaussian with the median of these absolute values: 1.4826 times it.
pub(crate) fn robust_deviation(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    median(residuals.map(f64::abs)).map(|m| 1.4826 * m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_weights_give_the_median() {
        assert_eq!(weighted_quantile(&mut [(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(2.0));
        assert_eq!(weighted_quantile(&mut [(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(3.0));
        assert_eq!(weighted_quantile(&mut [(3.0, 0.0)], 0.5), None);
        assert_eq!(robust_deviation([-1.0, 2.0, -3.0].into_iter()), Some(2.0 * 1.4826));
        assert_eq!(robust_deviation(std::iter::empty()), None);
    }
}
