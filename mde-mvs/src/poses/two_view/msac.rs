//! The model that most points obey, from random samples (MSAC; Torr and Zisserman, 2000).

use mde_uncertainty::random::CounterRng;
use rand::RngExt;

/// Samples at most.
const SAMPLES: usize = 2000;

/// From which stream of random numbers samples are drawn.
pub(super) struct Ransac {
    pub(super) seed: u64,
    pub(super) purpose: &'static str,
    pub(super) stream: u64,
}

/// Chance that no sample was free of wrong pairs when the search ends.
const MISS: f64 = 1e-4;

/// The best of the models that samples of `N` of `count` points make, by the score \\( \sum_i \max(0, 1 - d_i^2 / l) \\) with squared
/// distances \\( d_i^2 \\) and the limit \\( l \\). `improve` may replace a new best model and its score by better ones.
pub(super) fn msac<M, const N: usize>(
    count: usize,
    limit: f64,
    ransac: &Ransac,
    models: impl Fn([usize; N]) -> Vec<M>,
    squared_distance: impl Fn(&M, usize) -> f64,
    improve: impl Fn(M, f64) -> (M, f64),
) -> Option<M> {
    let mut best: Option<(f64, M)> = None;
    let mut needed = SAMPLES;
    let mut iteration = 0;
    while iteration < needed {
        let chosen = draw::<N>(count, ransac, iteration);
        iteration += 1;
        for model in models(chosen) {
            let value = score(count, limit, |i| squared_distance(&model, i));
            if best.as_ref().is_some_and(|(top, _)| value <= *top) {
                continue;
            }
            let (model, value) = improve(model, value);
            let inliers = (0..count).filter(|&i| squared_distance(&model, i) < limit).count();
            needed = needed.min(samples(inliers as f64 / count as f64, N));
            best = Some((value, model));
        }
    }
    best.map(|(_, model)| model)
}

/// The score of a model; see [`msac`].
pub(super) fn score(count: usize, limit: f64, squared_distance: impl Fn(usize) -> f64) -> f64 {
    (0..count).map(|i| (1.0 - squared_distance(i) / limit).max(0.0)).sum()
}

/// Samples after which one of `size` pairs without a wrong one was missed with a chance of 1e-4 only.
fn samples(inlier_share: f64, size: usize) -> usize {
    let good = inlier_share.powi(size as i32).clamp(1e-12, 1.0 - 1e-12);
    (MISS.ln() / (1.0 - good).ln()).ceil() as usize
}

/// `N` different indices below `count`, which is at least `N`.
fn draw<const N: usize>(count: usize, ransac: &Ransac, iteration: usize) -> [usize; N] {
    let stream = ransac.stream << 32 | iteration as u64;
    let mut rng = CounterRng::new(ransac.seed, ransac.purpose, stream, 0);
    let mut chosen = [0; N];
    for i in 0..N {
        // Floyd's sampling: every set has the same chance, with one draw for each member.
        let top = count - N + i;
        let index = rng.random_range(0..=top);
        chosen[i] = if chosen[..i].contains(&index) { top } else { index };
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every index is drawn equally often, and none twice in a sample.
    #[test]
    fn samples_are_uniform_sets() {
        let ransac = Ransac { seed: 3, purpose: "test", stream: 1 };
        let mut counts = [0; 10];
        for iteration in 0..20_000 {
            let mut chosen = draw::<4>(10, &ransac, iteration);
            chosen.iter().for_each(|&i| counts[i] += 1);
            chosen.sort_unstable();
            assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
        }
        assert!(counts.iter().all(|&n| (7700..8300).contains(&n)), "{counts:?}");
        assert_eq!(draw::<3>(3, &ransac, 0).iter().sum::<usize>(), 3);
    }

    #[test]
    fn half_right_pairs_need_the_textbook_number_of_samples() {
        assert_eq!(samples(0.5, 7), (1e-4_f64.ln() / (1.0 - 0.5_f64.powi(7)).ln()).ceil() as usize);
        assert!(samples(0.0, 7) > 1_000_000 && samples(1.0, 7) == 1);
    }
}
