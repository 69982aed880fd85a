//! Random numbers from one seed and a counter.
//!
//! A draw depends on `(seed, purpose, step, index)` only, never on the order in which threads draw, so that a run gives the
//! same bits with any number of threads.

use rand::TryRng;
use rand::rand_core::utils::fill_bytes_via_next_word;
use std::convert::Infallible;

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A stream of random bits for one `(seed, purpose, step, index)`: SplitMix64 (Steele, Lea and Flood, 2014) from a hashed
/// state. A generator for any distribution of [`rand`].
///
/// ```
/// use mde_uncertainty::random::CounterRng;
/// use rand::RngExt;
///
/// let draw = |index| CounterRng::new(7, "doc-example", 0, index).random::<f64>();
/// assert_eq!(draw(3), draw(3));
/// assert_ne!(draw(3), draw(4));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CounterRng {
    state: u64,
}

impl CounterRng {
    /// The stream of `seed` for one `purpose` (a name that is unique to this use of the seed), `step` and `index`.
    pub fn new(seed: u64, purpose: &str, step: u64, index: u64) -> Self {
        // FNV-1a of the name; the mixing below does the rest.
        let purpose = purpose.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let state = [purpose, step, index]
            .into_iter()
            .fold(mix(seed), |state, word| mix(state ^ mix(word.wrapping_add(GOLDEN))));
        Self { state }
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }
}

/// A seed of its own for the `index`-th use of `seed` for one `purpose`.
///
/// Sums such as `seed + index` make neighbouring seeds share draws; derived seeds are hashed, and coincide with others or with
/// small seeds with a probability of about \\(2^{-64}\\) each.
///
/// ```
/// use mde_uncertainty::random::derived_seed;
///
/// assert_eq!(derived_seed(0, "poses", 1), derived_seed(0, "poses", 1));
/// assert_ne!(derived_seed(0, "poses", 1), derived_seed(1, "poses", 0));
/// ```
pub fn derived_seed(seed: u64, purpose: &str, index: u64) -> u64 {
    CounterRng::new(seed, purpose, index, 0).bits()
}

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl TryRng for CounterRng {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.bits() >> 32) as u32)
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.bits())
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        fill_bytes_via_next_word(bytes, || self.try_next_u64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn every_part_of_the_counter_matters() {
        let first =
            |(seed, purpose, step, index)| CounterRng::new(seed, purpose, step, index).random::<u64>();
        let others = [(2, "a", 2, 3), (1, "b", 2, 3), (1, "a", 3, 3), (1, "a", 2, 4), (1, "a", 3, 2)];
        assert!(others.into_iter().all(|other| first(other) != first((1, "a", 2, 3))));
    }

    /// Runs with neighbouring seeds share no seed for any of their iterations.
    #[test]
    fn derived_seeds_of_neighbouring_seeds_differ() {
        let mut all: Vec<u64> =
            (0..100).flat_map(|seed| (0..100).map(move |index| derived_seed(seed, "field", index))).collect();
        all.extend(0..100);
        all.sort_unstable();
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]));
    }

    /// Neighbouring counters must look independent: mean 1/2, variance 1/12, and no lag correlation over indices.
    #[test]
    fn first_draws_of_neighbouring_indices_are_uniform_and_uncorrelated() {
        let n = 100_000;
        let x: Vec<f64> = (0..n).map(|i| CounterRng::new(0, "uniform", 0, i).random()).collect();
        let mean = x.iter().sum::<f64>() / n as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
        let lag = x.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 5e-3 && (variance - 1.0 / 12.0).abs() < 2e-3 && lag.abs() < 1.5e-3);
    }
}
