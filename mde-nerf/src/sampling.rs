//! Positions along a ray, as fractions of its range.

use rand::{Rng, RngExt};

/// Weight that the importance sampler adds to every bin, as a share of the whole, so that none is forgotten.
const PADDING: f64 = 0.01;

/// `count` positions over `[low, high]`, one in each of as many equal strata; in the middle without a generator.
pub(crate) fn stratified(
    count: usize,
    low: f64,
    high: f64,
    mut rng: Option<&mut impl Rng>,
    out: &mut Vec<f64>,
) {
    let step = (high - low) / count.max(1) as f64;
    out.extend((0..count).map(|i| {
        let jitter = rng.as_mut().map_or(0.5, |rng| rng.random::<f64>());
        low + step * (i as f64 + jitter)
    }));
}

/// Edges of the bins around sorted positions: halfway between neighbours, 0 and 1 at the ends.
pub(crate) fn edges(positions: &[f64], out: &mut Vec<f64>) {
    out.clear();
    out.push(0.0);
    out.extend(positions.windows(2).map(|p| 0.5 * (p[0] + p[1])));
    out.push(1.0);
}

/// Weights that cover what point samples miss: each becomes the mean of the larger of it and either neighbour
/// (Barron et al., 2021), and gets a little more.
///
/// A surface between two samples shows in the one behind it only, though it may lie in the bin of the one before.
pub(crate) fn blurred(weights: &[f64], out: &mut Vec<f64>) {
    let at = |i: usize| weights.get(i).copied().unwrap_or(0.0);
    let padding = PADDING * weights.iter().sum::<f64>().max(1e-6) / weights.len().max(1) as f64;
    out.clear();
    out.extend((0..weights.len()).map(|i| {
        let before = if i > 0 { at(i - 1) } else { 0.0 };
        0.5 * (at(i).max(before) + at(i).max(at(i + 1))) + padding
    }));
}

/// `count` positions drawn from the piecewise uniform density that puts `weights[i]` between `edges[i]` and
/// `edges[i + 1]`, stratified over its distribution function; at the strata's middles without a generator.
pub(crate) fn importance(
    count: usize,
    edges: &[f64],
    weights: &[f64],
    mut rng: Option<&mut impl Rng>,
    out: &mut Vec<f64>,
) {
    let total: f64 = weights.iter().sum();
    let mut bin = 0;
    let mut below = 0.0;
    for i in 0..count {
        let jitter = rng.as_mut().map_or(0.5, |rng| rng.random::<f64>());
        let target = total * (i as f64 + jitter) / count as f64;
        while bin + 1 < weights.len() && below + weights[bin] < target {
            below += weights[bin];
            bin += 1;
        }
        let within = ((target - below) / weights[bin]).clamp(0.0, 1.0);
        out.push(edges[bin] + within * (edges[bin + 1] - edges[bin]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_warp::random::CounterRng;
    use proptest::prelude::*;

    fn rng(seed: u64) -> CounterRng {
        CounterRng::new(seed, "sampling-test", 0, 0)
    }

    proptest! {
        #[test]
        fn every_stratum_gets_one(seed: u64, count in 1..60_usize, low in 0.0..0.5_f64, width in 0.01..0.5_f64) {
            let mut out = Vec::new();
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

        /// The bin before a weight, where the surface that it saw may lie, gets at least half of it; none gets nothing.
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
