//! Sample positions along a ray, as fractions of its range.

use crate::scalar::Scalar;
use rand::{Rng, RngExt};

/// Weight that the importance sampler adds to every bin, as a share of the total, so that no bin is left out.
const PADDING: f64 = 0.01;

/// `count` positions over `[low, high]`, one in each of as many equal strata; in the middle without a generator.
#[inline(always)]
pub(crate) fn stratified<T: Scalar>(
    count: usize,
    low: f64,
    high: f64,
    mut rng: Option<&mut impl Rng>,
    out: &mut Vec<T>,
) {
    let (low, step) = (T::from_f64(low), T::from_f64((high - low) / count.max(1) as f64));
    out.extend((0..count).map(|i| low + step * (T::from_index(i as u32) + jitter(rng.as_mut()))));
}

/// Position of a sample in its stratum.
#[inline(always)]
fn jitter<T: Scalar>(rng: Option<&mut impl Rng>) -> T {
    rng.map_or(T::from_f64(0.5), |rng| T::from_f64(rng.random::<f64>()))
}

/// Merges two sorted lists; `sources` receives the index of each position in the concatenation of `first` and `second`.
#[inline(always)]
pub(crate) fn merge<T: Scalar>(first: &[T], second: &[T], positions: &mut Vec<T>, sources: &mut Vec<u32>) {
    positions.clear();
    sources.clear();
    let (mut i, mut j) = (0, 0);
    while i < first.len() && j < second.len() {
        let take_first = first[i] <= second[j];
        let (position, source) = if take_first { (first[i], i) } else { (second[j], first.len() + j) };
        i += usize::from(take_first);
        j += usize::from(!take_first);
        positions.push(position);
        sources.push(source as u32);
    }
    positions.extend_from_slice(&first[i..]);
    sources.extend(i as u32..first.len() as u32);
    positions.extend_from_slice(&second[j..]);
    sources.extend((first.len() + j) as u32..(first.len() + second.len()) as u32);
}

/// Edges of the bins around sorted positions: halfway between neighbours, 0 and 1 at the ends.
#[inline(always)]
pub(crate) fn edges<T: Scalar>(positions: &[T], out: &mut Vec<T>) {
    let half = T::from_f64(0.5);
    out.clear();
    out.push(T::ZERO);
    out.extend(positions.windows(2).map(|p| half * (p[0] + p[1])));
    out.push(T::ONE);
}

/// Blurred weights: the mean of the maxima with either neighbour (Barron et al., 2021), plus a padding.
///
/// A surface between two samples gives weight only to the one behind it, but may lie in the bin of the one in front.
#[inline(always)]
pub(crate) fn blurred<T: Scalar>(weights: &[T], out: &mut Vec<T>) {
    let total: T = weights.iter().copied().sum();
    let padding = total.max(T::from_f64(1e-6)) * T::from_f64(PADDING / weights.len().max(1) as f64);
    let half = T::from_f64(0.5);
    out.clear();
    let mut before = T::ZERO;
    out.extend(weights.iter().enumerate().map(|(i, &w)| {
        let after = weights.get(i + 1).copied().unwrap_or(T::ZERO);
        let blurred = half * (w.max(before) + w.max(after)) + padding;
        before = w;
        blurred
    }));
}

/// `count` positions drawn from the piecewise uniform density that puts `weights[i]` between `edges[i]` and
/// `edges[i + 1]`, stratified over its distribution function; at the strata's middles without a generator.
#[inline(always)]
pub(crate) fn importance<T: Scalar>(
    count: usize,
    edges: &[T],
    weights: &[T],
    mut rng: Option<&mut impl Rng>,
    out: &mut Vec<T>,
) {
    let total: T = weights.iter().copied().sum();
    let stratum = total / T::from_index(count.max(1) as u32);
    let mut bin = 0;
    let mut below = T::ZERO;
    for i in 0..count {
        let target = stratum * (T::from_index(i as u32) + jitter(rng.as_mut()));
        while bin + 1 < weights.len() && below + weights[bin] < target {
            below += weights[bin];
            bin += 1;
        }
        let within = ((target - below) / weights[bin]).max(T::ZERO).min(T::ONE);
        out.push(edges[bin] + within * (edges[bin + 1] - edges[bin]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::random::CounterRng;
    use proptest::prelude::*;

    fn rng(seed: u64) -> CounterRng {
        CounterRng::new(seed, "sampling-test", 0, 0)
    }

    proptest! {
        #[test]
        fn every_stratum_gets_one(seed: u64, count in 1..60_usize, low in 0.0..0.5_f64, width in 0.01..0.5_f64) {
            let mut out = Vec::<f64>::new();
            stratified(count, low, low + width, Some(&mut rng(seed)), &mut out);
            for (i, x) in out.iter().enumerate() {
                let stratum = ((x - low) / width * count as f64).floor() as usize;
                prop_assert!(stratum == i || (stratum == i + 1 && (x - low) / width * count as f64 - stratum as f64 <= 1e-9));
            }
        }

        #[test]
        fn importance_samples_are_sorted_and_follow_the_weights(
            seed: u64, weights in proptest::collection::vec(1e-3..1.0_f64, 1..20)
        ) {
            let positions: Vec<f64> = (0..weights.len()).map(|i| (i as f64 + 0.5) / weights.len() as f64).collect();
            let (mut bounds, mut out) = (Vec::new(), Vec::new());
            edges(&positions, &mut bounds);
            let count = 2000;
            importance(count, &bounds, &weights, Some(&mut rng(seed)), &mut out);
            prop_assert!(out.windows(2).all(|w| w[0] <= w[1]) && out.iter().all(|x| (0.0..=1.0).contains(x)));
            let total = weights.iter().sum::<f64>();
            for (i, w) in weights.iter().enumerate() {
                let share = out.iter().filter(|&&x| x >= bounds[i] && x < bounds[i + 1]).count() as f64 / count as f64;
                prop_assert!((share - w / total).abs() < 3.0 / count as f64 + 1e-9);
            }
        }

        #[test]
        fn merging_sorts_and_gives_the_sources(seed: u64, a in 0..20_usize, b in 0..20_usize) {
            let sorted = |index, n: usize| {
                let mut list: Vec<f64> = Vec::new();
                stratified(n, 0.0, 1.0, Some(&mut CounterRng::new(seed, "merge-test", 0, index)), &mut list);
                list
            };
            let (first, second) = (sorted(0, a), sorted(1, b));
            let (mut positions, mut sources) = (Vec::new(), Vec::new());
            merge(&first, &second, &mut positions, &mut sources);
            let both: Vec<f64> = first.iter().chain(&second).copied().collect();
            prop_assert!(positions.windows(2).all(|w| w[0] <= w[1]) && positions.len() == a + b);
            prop_assert!(positions.iter().zip(&sources).all(|(p, &at)| *p == both[at as usize]));
        }

        /// The bin in front of a weight, where its surface may lie, gets at least half of it; no bin gets 0.
        #[test]
        fn blurring_reaches_the_neighbours(weights in proptest::collection::vec(0.0..1.0_f64, 2..20)) {
            let mut out = Vec::new();
            blurred(&weights, &mut out);
            for i in 0..weights.len() {
                prop_assert!(out[i] > 0.0 && out[i] >= weights[i]);
                prop_assert!(i == 0 || out[i - 1] >= 0.5 * weights[i]);
            }
        }
    }
}
