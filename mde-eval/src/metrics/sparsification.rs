//! Sparsification: errors that remain when the most uncertain pixels are removed.
//!
//! A curve of the mean cost over what is kept, once in order of the predicted sigma, once in order of the cost itself (the oracle), once in
//! no order (random, a flat line). **AUSE** is the area between the first and the oracle (0 is best), **AURG** the area that the first
//! gains over random. Pixels of equal sigma leave together: their mean stands for each of them, which is the expectation over how ties are
//! broken. A constant sigma therefore gives the random curve and not an accident of the pixels' order.

use crate::Result;
use crate::error::{self, List, check_lists};
use mde_uncertainty::statistics::Order;
use serde::{Deserialize, Serialize};

/// How the kept costs become one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// Their mean: for \\(|e|\\), \\(e^2\\), \\(|e|/g\\), outlier flags.
    Mean,
    /// The root of their mean: for \\(e^2\\), giving RMSE.
    RootMean,
}

/// The three curves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Sparsification {
    /// Share of the pixels that has been removed, rising from 0.
    pub removed: Vec<f64>,
    /// Cost of what is left, the most uncertain removed first.
    pub by_sigma: Vec<f64>,
    /// Cost of what is left, the costliest removed first.
    pub oracle: Vec<f64>,
    /// Cost of all pixels: what is left, in expectation, when pixels go by chance.
    pub random: f64,
}

impl Sparsification {
    /// \\(\int (C_\sigma - C_\text{oracle})\\,\mathrm d r\\) by the trapezoidal rule; 0 for the oracle.
    pub fn ause(&self) -> f64 {
        trapezoid(&self.removed, &self.by_sigma) - trapezoid(&self.removed, &self.oracle)
    }

    /// \\(C_\text{random} - \int C_\sigma\\,\mathrm d r\\) by the trapezoidal rule; positive where sigma beats chance.
    pub fn aurg(&self) -> f64 {
        self.random - trapezoid(&self.removed, &self.by_sigma)
    }
}

/// AUSE's curves after Bayes' Rays (Goli et al., CVPR 2024; `ause.py`, from CF-NeRF).
///
/// With \\(r_k = k / 100\\), \\(k = 0 \dots 99\\), the first \\(\lfloor (1 - r_k) n \rfloor\\) pixels (at least one) in order of sigma and of cost
/// are reduced, and all curves are divided by the joint maximum of both, so that AUSE has no unit. `costs` and `sigma`
/// have one entry per pixel; costs are not negative.
///
/// # Errors
/// [`Error::Length`](crate::Error::Length) where the lists differ, [`Error::Empty`](crate::Error::Empty) without pixels,
/// [`Error::Value`](crate::Error::Value) for a NaN or a negative cost.
pub fn sparsify(costs: &[f64], sigma: &[f64], reduction: Reduction) -> Result<Sparsification> {
    let removed: Vec<f64> = (0..100).map(|k| f64::from(k) * 0.01).collect();
    let kept = removed.iter().map(|r| (((1.0 - r) * costs.len() as f64) as usize).max(1));
    let mut curves = curves((costs, sigma), reduction, removed.clone(), kept)?;
    let largest = curves.by_sigma.iter().chain(&curves.oracle).copied().fold(0.0, f64::max);
    if largest > 0.0 {
        let values = curves.by_sigma.iter_mut().chain(&mut curves.oracle);
        values.chain([&mut curves.random]).for_each(|value| *value /= largest);
    }
    Ok(curves)
}

/// The curves over the first `kept` pixels in order of sigma and of cost.
fn curves(
    (costs, sigma): (&[f64], &[f64]),
    reduction: Reduction,
    removed: Vec<f64>,
    kept: impl Iterator<Item = usize> + Clone,
) -> Result<Sparsification> {
    check(costs, sigma)?;
    let mut sorted = costs.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let by_sigma = running_sums(&expected(&Order::new(sigma)?, costs));
    let oracle = running_sums(&sorted);
    let left = |sums: &[f64], kept: usize| match reduction {
        Reduction::Mean => sums[kept] / kept as f64,
        Reduction::RootMean => (sums[kept] / kept as f64).max(0.0).sqrt(),
    };
    Ok(Sparsification {
        removed,
        by_sigma: kept.clone().map(|k| left(&by_sigma, k)).collect(),
        oracle: kept.map(|k| left(&oracle, k)).collect(),
        random: left(&oracle, costs.len()),
    })
}

/// Costs by percentile of the uncertainty (the paper's Figure 2 with 100 bins of \\(|e|\\)): mean sigma and mean cost of each bin.
///
/// The pixels in order of sigma, cut into `bins` runs of equal size up to one (fewer where there are fewer pixels). Ties
/// that straddle a cut are averaged.
///
/// # Errors
/// As [`sparsify`]; [`Error::Config`](crate::Error::Config) for 0 bins.
pub fn costs_by_uncertainty(costs: &[f64], sigma: &[f64], bins: usize) -> Result<Vec<(f64, f64)>> {
    check(costs, sigma)?;
    error::check([("bins", bins as f64, bins > 0, "use at least 1")])?;
    let (n, bins) = (costs.len(), bins.min(costs.len()));
    let order = Order::new(sigma)?;
    let (sigma, costs) = (expected(&order, sigma), expected(&order, costs));
    // About the first value: the mean of equal values is that value, and bins of ties are ties.
    let mean =
        |values: &[f64]| values[0] + values.iter().map(|v| v - values[0]).sum::<f64>() / values.len() as f64;
    let bin = |k: usize| {
        let run = k * n / bins..(k + 1) * n / bins;
        (mean(&sigma[run.clone()]), mean(&costs[run]))
    };
    Ok((0..bins).map(bin).collect())
}

fn check(costs: &[f64], sigma: &[f64]) -> Result<()> {
    let any: List<'_> = ("sigma", sigma, |_| true, "a number");
    let costs: List<'_> = ("the cost", costs, |c| c >= 0.0 && c.is_finite(), "finite and at least 0");
    check_lists("the sparsification", [any, costs])
}

/// `costs` in the order of a key, each the mean of its run of equal keys: the expectation when ties are broken at random.
pub(super) fn expected(order: &Order, costs: &[f64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(costs.len());
    for tied in order.ties() {
        let mean = tied.iter().map(|&at| costs[at as usize]).sum::<f64>() / tied.len() as f64;
        out.extend(std::iter::repeat_n(mean, tied.len()));
    }
    out
}

/// Sums of the first 0, 1, 2, ... values.
pub(crate) fn running_sums<'v>(values: impl IntoIterator<Item = &'v f64>) -> Vec<f64> {
    let mut total = 0.0;
    let sums = values.into_iter().map(|value| {
        total += value;
        total
    });
    std::iter::once(0.0).chain(sums).collect()
}

fn trapezoid(x: &[f64], y: &[f64]) -> f64 {
    x.windows(2).zip(y.windows(2)).map(|(x, y)| 0.5 * (x[1] - x[0]) * (y[0] + y[1])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_oracle_has_no_area_and_nothing_is_below_it(
            pixels in proptest::collection::vec((0.0..5.0_f64, 0..20_u8), 1..300)
        ) {
            let (costs, sigma): (Vec<f64>, Vec<f64>) = pixels.iter().map(|&(c, s)| (c, f64::from(s))).unzip();
            for reduction in [Reduction::Mean, Reduction::RootMean] {
                prop_assert!(sparsify(&costs, &costs, reduction).unwrap().ause().abs() < 1e-12);
                let curves = sparsify(&costs, &sigma, reduction).unwrap();
                prop_assert!(curves.ause() >= -1e-12);
                prop_assert!(curves.by_sigma.iter().zip(&curves.oracle).all(|(s, o)| s - o >= -1e-12));
            }
        }

        #[test]
        fn ties_do_not_depend_on_the_order_of_pixels(
            pixels in proptest::collection::vec((0.0..5.0_f64, 0..4_u8), 2..200), shift in 1..50_usize
        ) {
            let value = |pixels: &[(f64, u8)]| {
                let (costs, sigma): (Vec<f64>, Vec<f64>) = pixels.iter().map(|&(c, s)| (c, f64::from(s))).unzip();
                sparsify(&costs, &sigma, Reduction::Mean).unwrap().ause()
            };
            let mut moved = pixels.clone();
            moved.rotate_left(shift % pixels.len());
            moved.reverse();
            prop_assert!((value(&pixels) - value(&moved)).abs() < 1e-9);
        }

        #[test]
        fn a_constant_sigma_is_chance(costs in proptest::collection::vec(0.0..5.0_f64, 1..200)) {
            let curves = sparsify(&costs, &vec![0.3; costs.len()], Reduction::Mean).unwrap();
            prop_assert!(curves.by_sigma.iter().all(|c| (c - curves.random).abs() < 1e-9));
        }

        #[test]
        fn bins_hold_every_pixel(costs in proptest::collection::vec(0.0..5.0_f64, 1..400)) {
            let sigma: Vec<f64> = costs.iter().map(|c| c * 2.0 + 1.0).collect();
            let bins = costs_by_uncertainty(&costs, &sigma, 100).unwrap();
            prop_assert_eq!(bins.len(), costs.len().min(100));
            prop_assert!(bins.windows(2).all(|b| b[0].0 <= b[1].0 && b[0].1 <= b[1].1));
        }
    }

    #[test]
    fn no_error_at_all_is_no_area() {
        let curves = sparsify(&[0.0; 7], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], Reduction::RootMean).unwrap();
        assert_eq!((curves.ause(), curves.aurg()), (0.0, 0.0));
    }
}
