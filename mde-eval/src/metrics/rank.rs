//! Ranks and their correlation.

use crate::{Error, Result};

/// Average ranks, from 1: tied values share the mean of the ranks that they take up.
///
/// # Errors
/// [`Error::Value`] for a NaN.
pub fn average_ranks(values: &[f64]) -> Result<Vec<f64>> {
    Ok(Order::new("the value to rank", values)?.ranks(values))
}

/// Spearman's rank correlation with [average ranks](average_ranks):
///
/// \\[ \rho = \frac{\sum_i (r_i - \bar r)(s_i - \bar s)}{\sqrt{\sum_i (r_i - \bar r)^2 \sum_i (s_i - \bar s)^2}} \\]
///
/// Nothing where one side is constant or there are fewer than two values. No monotone rising map of either side moves it.
///
/// # Errors
/// [`Error::Length`] where the lists differ, [`Error::Value`] for a NaN.
pub fn spearman(x: &[f64], y: &[f64]) -> Result<Option<f64>> {
    if x.len() != y.len() {
        return Err(Error::Length { what: "the second list", found: y.len(), expected: x.len() });
    }
    Ok(pearson(&average_ranks(x)?, &average_ranks(y)?))
}

/// [`spearman`] of two lists, each with its order.
pub(crate) fn spearman_in_order(x: (&[f64], &Order), y: (&[f64], &Order)) -> Option<f64> {
    pearson(&x.1.ranks(x.0), &y.1.ranks(y.0))
}

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

/// Indices of a list by rising value.
pub(crate) struct Order(Vec<u32>);

impl Order {
    pub(crate) fn new(what: &'static str, values: &[f64]) -> Result<Self> {
        if let Some(index) = values.iter().position(|v| v.is_nan()) {
            return Err(Error::Value { what, index, value: values[index], expected: "a number" });
        }
        // Keys beside the indices: a sort that looks values up through indices misses the cache at every comparison.
        let mut keyed: Vec<(u64, u32)> = values.iter().map(|&v| rising_bits(v)).zip(0..).collect();
        keyed.sort_unstable();
        Ok(Self(keyed.into_iter().map(|(_, at)| at).collect()))
    }

    /// Of a list that rises already.
    pub(crate) fn of_sorted(values: &[f64]) -> Self {
        Self((0..).zip(values).map(|(at, _)| at).collect())
    }

    /// `values` in this order.
    pub(crate) fn apply(&self, values: &[f64]) -> Vec<f64> {
        self.0.iter().map(|&at| values[at as usize]).collect()
    }

    /// Average ranks, from 1.
    pub(crate) fn ranks(&self, values: &[f64]) -> Vec<f64> {
        let mut ranks = vec![0.0; values.len()];
        let mut before = 0;
        for tied in self.ties(values) {
            let rank = before as f64 + 0.5 * (tied.len() + 1) as f64;
            tied.iter().for_each(|&at| ranks[at as usize] = rank);
            before += tied.len();
        }
        ranks
    }

    /// Runs of indices with equal values.
    pub(crate) fn ties<'a>(&'a self, values: &'a [f64]) -> impl Iterator<Item = &'a [u32]> {
        self.0.chunk_by(|&a, &b| values[a as usize] == values[b as usize])
    }

    /// `costs` in this order (that of `keys`), with the mean over each run of ties in place of its members: what is
    /// expected when ties are broken by chance.
    pub(crate) fn expected(&self, keys: &[f64], costs: &[f64]) -> Vec<f64> {
        let mut out = Vec::with_capacity(costs.len());
        for tied in self.ties(keys) {
            let mean = tied.iter().map(|&at| costs[at as usize]).sum::<f64>() / tied.len() as f64;
            out.extend(std::iter::repeat_n(mean, tied.len()));
        }
        out
    }
}

/// Bits that compare as the numbers do, with both zeros alike.
fn rising_bits(value: f64) -> u64 {
    let bits = (value + 0.0).to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ties_share_their_mean_rank() {
        assert_eq!(average_ranks(&[3.0, 1.0, 3.0, -2.0, 3.0]).unwrap(), [4.0, 2.0, 4.0, 1.0, 4.0]);
        assert_eq!(average_ranks(&[0.0, -0.0, -1.0]).unwrap(), [2.5, 2.5, 1.0]);
        assert!(average_ranks(&[0.0, f64::NAN]).is_err());
    }

    #[test]
    fn constants_have_no_correlation() {
        assert_eq!(spearman(&[1.0, 1.0], &[1.0, 2.0]).unwrap(), None);
        assert_eq!(spearman(&[1.0], &[2.0]).unwrap(), None);
        assert_eq!(spearman(&[], &[]).unwrap(), None);
        assert!(spearman(&[1.0], &[]).is_err());
    }

    proptest! {
        #[test]
        fn no_rising_map_moves_it(values in proptest::collection::vec((-40..40_i32, -40..40_i32), 2..60)) {
            let (x, y): (Vec<f64>, Vec<f64>) = values.iter().map(|&(a, b)| (f64::from(a), f64::from(b))).unzip();
            let rho = spearman(&x, &y).unwrap();
            let bent: Vec<f64> = x.iter().map(|v| (v / 10.0).exp() + v.powi(3)).collect();
            prop_assert_eq!(spearman(&bent, &y).unwrap(), rho);
            let turned: Vec<f64> = y.iter().map(|v| -v).collect();
            let reversed = spearman(&x, &turned).unwrap();
            prop_assert!(reversed.zip(rho).is_none_or(|(a, b)| (a + b).abs() < 1e-12));
        }

        #[test]
        fn ranks_add_up_and_keep_the_order(values in proptest::collection::vec(-9..9_i32, 1..50)) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let ranks = average_ranks(&values).unwrap();
            let n = values.len() as f64;
            prop_assert!((ranks.iter().sum::<f64>() - n * (n + 1.0) / 2.0).abs() < 1e-9);
            for (i, j) in (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
                prop_assert_eq!(values[i].partial_cmp(&values[j]), ranks[i].partial_cmp(&ranks[j]));
            }
        }
    }
}
