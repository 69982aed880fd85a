//! Ranks and their correlation, from [`mde_uncertainty::statistics`].

pub use mde_uncertainty::statistics::{average_ranks, spearman};

use mde_uncertainty::statistics::Order;

/// `costs` in the order of a key, with the mean over each run of equal keys in place of its members: the expectation when
/// ties are broken at random.
pub(crate) fn expected(order: &Order, costs: &[f64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(costs.len());
    for tied in order.ties() {
        let mean = tied.iter().map(|&at| costs[at as usize]).sum::<f64>() / tied.len() as f64;
        out.extend(std::iter::repeat_n(mean, tied.len()));
    }
    out
}
