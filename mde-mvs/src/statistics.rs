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

/// The `share`-quantile, linear between order statistics; nothing without values. Reorders `values`.
pub(crate) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let position = share.clamp(0.0, 1.0) * last as f64;
    let below = (position as usize).min(last);
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    Some(low + (position - below as f64) * (high - low))
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
    fn equal_weights_give_the_median() {
        assert_eq!(weighted_quantile(&mut [(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(2.0));
        assert_eq!(weighted_quantile(&mut [(3.0, 5.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(3.0));
        assert_eq!(weighted_quantile(&mut [(3.0, 0.0)], 0.5), None);
        assert_eq!(quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5), Some(2.5));
        assert_eq!(quantile(&mut [], 0.5), None);
    }
}
