use std::cmp::Ordering;

/// The `q`-quantile (`q` in 0 to 1) with linear interpolation between order statistics; `None` without values.
///
/// Reorders `values`.
pub(crate) fn quantile(values: &mut [f32], q: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let position = q.clamp(0.0, 1.0) * last as f64;
    let below = (position as usize).min(last);
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f32::total_cmp);
    let low = f64::from(low);
    let high = above.iter().copied().min_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
    Some(low + (position - below as f64) * (high.map_or(low, f64::from) - low))
}

/// The median, the mean of the two middle values where their number is even.
pub(crate) fn median(values: impl IntoIterator<Item = f32>) -> Option<f64> {
    quantile(&mut values.into_iter().collect::<Vec<_>>(), 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_like_the_usual_definition() {
        assert_eq!(median([]), None);
        assert_eq!(median([3.0]), Some(3.0));
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), Some(2.5));
        let mut values = [5.0, 1.0, 2.0, 4.0, 3.0];
        assert_eq!(quantile(&mut values, 0.0), Some(1.0));
        assert_eq!(quantile(&mut values, 0.25), Some(2.0));
        assert_eq!(quantile(&mut values, 0.05), Some(1.2));
        assert_eq!(quantile(&mut values, 1.0), Some(5.0));
    }
}
