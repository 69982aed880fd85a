//! Order statistics and rank correlation: the definitions that every crate of this workspace shares.
//!
//! Values are ordered by the total order of IEEE 754, in which NaN with a positive sign comes last. Filter values that
//! are not finite beforehand where they should not count.

use crate::{Error, Result};
use num_traits::float::TotalOrder;

/// A number that order statistics are defined for: `f32` or `f64`.
pub trait Value: Copy + Into<f64> + TotalOrder {}

impl Value for f32 {}
impl Value for f64 {}

/// The `p`-quantile with linear interpolation between order statistics, or `None` without values.
///
/// With \\(x_{(0)} \le \dots \le x_{(n-1)}\\), \\(h = p (n - 1)\\) and \\(k = \lfloor h \rfloor\\),
///
/// \\[ Q(p) = x_{(k)} + (h - k)\\,(x_{(k+1)} - x_{(k)}), \\]
///
/// type 7 of Hyndman and Fan (1996) and NumPy's default. `p` is clamped to 0 and 1. Reorders `values`; takes linear time.
///
/// ```
/// use mde_uncertainty::statistics::quantile;
///
/// assert_eq!(quantile(&mut [4.0, 1.0, 2.0, 8.0], 0.25), Some(1.75));
/// assert_eq!(quantile::<f32>(&mut [], 0.25), None);
/// ```
pub fn quantile<T: Value>(values: &mut [T], p: f64) -> Option<f64> {
    let (below, rest) = position(values.len(), p)?;
    let (_, &mut low, above) = values.select_nth_unstable_by(below, T::total_cmp);
    let high = if rest > 0.0 { above.iter().copied().min_by(T::total_cmp) } else { None };
    Some(interpolated(low, high.unwrap_or(low), rest))
}

/// [`quantile`] of values in rising order.
pub fn quantile_sorted<T: Value>(sorted: &[T], p: f64) -> Option<f64> {
    let (below, rest) = position(sorted.len(), p)?;
    let low = *sorted.get(below)?;
    Some(interpolated(low, sorted.get(below + 1).copied().unwrap_or(low), rest))
}

/// The value whose rank is nearest to the `p`-quantile's, of values in rising order: one of the values, never between two.
pub fn nearest_rank_sorted<T: Copy>(sorted: &[T], p: f64) -> Option<T> {
    let last = sorted.len().checked_sub(1)?;
    sorted.get((p.clamp(0.0, 1.0) * last as f64).round() as usize).copied()
}

/// The median, \\(Q(1/2)\\): the mean of the two middle values where their number is even, `None` without values.
///
/// ```
/// use mde_uncertainty::statistics::median;
///
/// let depth = [3.0_f32, f32::NAN, 1.0, 2.0];
/// assert_eq!(median(depth.into_iter().filter(|d| d.is_finite())), Some(2.0));
/// ```
pub fn median<T: Value>(values: impl IntoIterator<Item = T>) -> Option<f64> {
    quantile(&mut values.into_iter().collect::<Vec<_>>(), 0.5)
}

/// Index of the order statistic at or below the quantile, and the distance from there in ranks.
fn position(count: usize, p: f64) -> Option<(usize, f64)> {
    let last = count.checked_sub(1)?;
    let position = p.clamp(0.0, 1.0) * last as f64;
    let below = (position as usize).min(last);
    Some((below, position - below as f64))
}

fn interpolated<T: Value>(low: T, high: T, rest: f64) -> f64 {
    let (low, high) = (low.into(), high.into());
    match rest {
        // Equal infinities have no difference.
        _ if low >= high => low,
        0.0 => low,
        // The same for negated values.
        0.5 => 0.5 * low + 0.5 * high,
        _ => low + rest * (high - low),
    }
}

/// Average ranks, counted from 1: equal values share the mean of their ranks.
///
/// # Errors
/// [`Error::Value`] for a NaN.
pub fn average_ranks(values: &[f64]) -> Result<Vec<f64>> {
    Ok(Order::new(values)?.ranks())
}

/// Spearman's rank correlation with [average ranks](average_ranks):
///
/// \\[ \rho = \frac{\sum_i (r_i - \bar r)(s_i - \bar s)}{\sqrt{\sum_i (r_i - \bar r)^2 \sum_i (s_i - \bar s)^2}} \\]
///
/// `None` where one side is constant or has fewer than two values. Invariant under strictly increasing maps of either side.
///
/// # Errors
/// [`Error::Length`] where the lists differ in length, [`Error::Value`] for a NaN.
pub fn spearman(x: &[f64], y: &[f64]) -> Result<Option<f64>> {
    if x.len() != y.len() {
        return Err(Error::Length { what: "the second list", found: y.len(), expected: x.len() });
    }
    Ok(pearson(&average_ranks(x)?, &average_ranks(y)?))
}

/// Pearson's correlation of two lists of one length; `None` where one side is constant.
fn pearson(x: &[f64], y: &[f64]) -> Option<f64> {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (x_mean, y_mean) = (mean(x), mean(y));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (dx, dy) = (x - x_mean, y - y_mean);
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
    }
    (xx > 0.0 && yy > 0.0).then(|| (xy / (xx * yy).sqrt()).clamp(-1.0, 1.0))
}

/// The order of a list: its indices by rising value, in runs of equal values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Order {
    indices: Vec<u32>,
    /// Where each run of equal values ends in `indices`.
    ends: Vec<usize>,
}

impl Order {
    /// Sorts the indices of `values`.
    ///
    /// # Errors
    /// [`Error::Value`] for a NaN.
    pub fn new(values: &[f64]) -> Result<Self> {
        if let Some(index) = values.iter().position(|v| v.is_nan()) {
            let (what, value) = ("a value to rank", values[index]);
            return Err(Error::Value { what, index, value, remedy: "leave values out that are no numbers" });
        }
        // Keys beside the indices: a sort that looks values up through indices misses the cache at every comparison.
        let mut keyed: Vec<(u64, u32)> = values.iter().map(|&v| rising_bits(v)).zip(0..).collect();
        keyed.sort_unstable();
        let runs = keyed.chunk_by(|(a, _), (b, _)| a == b);
        let ends = runs.scan(0, |end, run| {
            *end += run.len();
            Some(*end)
        });
        Ok(Self { ends: ends.collect(), indices: keyed.into_iter().map(|(_, index)| index).collect() })
    }

    /// `values` in this order; indices that they do not have are left out.
    pub fn apply(&self, values: &[f64]) -> Vec<f64> {
        self.indices.iter().filter_map(|&index| values.get(index as usize).copied()).collect()
    }

    /// Average ranks, counted from 1.
    pub fn ranks(&self) -> Vec<f64> {
        let mut ranks = vec![0.0; self.indices.len()];
        let mut before = 0;
        for tied in self.ties() {
            let rank = before as f64 + 0.5 * (tied.len() + 1) as f64;
            tied.iter().for_each(|&index| ranks[index as usize] = rank);
            before += tied.len();
        }
        ranks
    }

    /// Runs of indices with equal values, by rising value.
    pub fn ties(&self) -> impl Iterator<Item = &[u32]> {
        let mut start = 0;
        self.ends.iter().map(move |&end| &self.indices[std::mem::replace(&mut start, end)..end])
    }
}

/// Bits that compare as the numbers do, with both zeros equal.
fn rising_bits(value: f64) -> u64 {
    let bits = (value + 0.0).to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::proptest::collection::vec;
    use ::proptest::prelude::*;

    /// From `numpy.quantile`.
    #[test]
    fn quantiles_equal_numpys() {
        let sorted = [1.0, 2.0, 4.0, 8.0];
        for (p, expected) in [(0.0, 1.0), (0.25, 1.75), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0)] {
            assert!((quantile_sorted(&sorted, p).unwrap() - expected).abs() < 1e-12);
            assert!((quantile(&mut [8.0, 1.0, 4.0, 2.0], p).unwrap() - expected).abs() < 1e-12);
        }
        assert_eq!(quantile_sorted(&[5.0_f32, 5.5], 7.0), Some(5.5));
        assert_eq!(quantile_sorted::<f64>(&[], 0.5), None);
    }

    #[test]
    fn medians_of_odd_even_and_empty_lists() {
        assert_eq!(median::<f32>([]), None);
        assert_eq!(median([3.0_f32, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median([f32::MAX, f32::MAX]), Some(f64::from(f32::MAX)));
        assert_eq!(median([f64::INFINITY; 2]), Some(f64::INFINITY));
    }

    #[test]
    fn the_nearest_rank_is_a_value_of_the_list() {
        let at = |p| nearest_rank_sorted(&[1.0_f32, 2.0, 4.0], p);
        assert_eq!([0.0, 0.24, 0.26, 0.9].map(at), [1.0, 1.0, 2.0, 4.0].map(Some));
        assert_eq!(nearest_rank_sorted::<f32>(&[], 0.5), None);
    }

    #[test]
    fn ties_share_their_mean_rank() {
        assert_eq!(average_ranks(&[3.0, 1.0, 3.0, -2.0, 3.0]).unwrap(), [4.0, 2.0, 4.0, 1.0, 4.0]);
        assert_eq!(average_ranks(&[0.0, -0.0, -1.0]).unwrap(), [2.5, 2.5, 1.0]);
        assert!(matches!(average_ranks(&[0.0, f64::NAN]), Err(Error::Value { index: 1, .. })));
    }

    #[test]
    fn constants_have_no_correlation() {
        assert_eq!(spearman(&[1.0, 1.0], &[1.0, 2.0]).unwrap(), None);
        assert_eq!(spearman(&[1.0], &[2.0]).unwrap(), None);
        assert_eq!(spearman(&[], &[]).unwrap(), None);
        assert!(matches!(spearman(&[1.0], &[]), Err(Error::Length { found: 0, expected: 1, .. })));
    }

    proptest! {
        #[test]
        fn both_quantiles_agree_and_never_fall(values in vec(-1e6..1e6_f64, 1..60), p in 0.0..1.0_f64, q in 0.0..1.0_f64) {
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let at = |p| quantile_sorted(&sorted, p).unwrap();
            prop_assert_eq!(quantile(&mut values.clone(), p), Some(at(p)));
            prop_assert!(at(p.min(q)) <= at(p.max(q)));
            prop_assert!(sorted[0] <= at(p) && at(p) <= sorted[sorted.len() - 1]);
        }

        #[test]
        fn spearman_is_invariant_under_increasing_maps(values in vec((-40..40_i32, -40..40_i32), 2..60)) {
            let (x, y): (Vec<f64>, Vec<f64>) = values.iter().map(|&(a, b)| (f64::from(a), f64::from(b))).unzip();
            let rho = spearman(&x, &y).unwrap();
            let bent: Vec<f64> = x.iter().map(|v| (v / 10.0).exp() + v.powi(3)).collect();
            prop_assert_eq!(spearman(&bent, &y).unwrap(), rho);
            let negated: Vec<f64> = y.iter().map(|v| -v).collect();
            let reversed = spearman(&x, &negated).unwrap();
            prop_assert!(reversed.zip(rho).is_none_or(|(a, b)| (a + b).abs() < 1e-12));
        }

        #[test]
        fn ranks_sum_to_the_triangular_number_and_keep_the_order(values in vec(-9..9_i32, 1..50)) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let order = Order::new(&values).unwrap();
            let ranks = order.ranks();
            let n = values.len() as f64;
            prop_assert!((ranks.iter().sum::<f64>() - n * (n + 1.0) / 2.0).abs() < 1e-9);
            for (i, j) in (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
                prop_assert_eq!(values[i].partial_cmp(&values[j]), ranks[i].partial_cmp(&ranks[j]));
            }
            let sorted = order.apply(&values);
            prop_assert!(sorted.is_sorted());
            prop_assert_eq!(average_ranks(&sorted).unwrap(), order.apply(&ranks));
        }
    }
}
