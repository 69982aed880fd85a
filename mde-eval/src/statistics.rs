//! What many scenes say of a difference: paired, with an interval.
//!
//! Scenes are the sample, not pixels: the pixels of one picture err together. A method is compared with a reference *on the
//! same scenes*, so that what makes a scene hard cancels, and the interval is the percentile bootstrap over scenes (Efron,
//! 1979): scenes are drawn with replacement, both methods' values with them.

use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::quantile_sorted;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A number and the interval that it is known to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value on the scenes at hand.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Estimate {
    /// Whether the interval leaves `value` out: whether the number differs from it beyond the chance of the scenes.
    pub fn excludes(&self, value: f64) -> bool {
        value < self.low || value > self.high
    }
}

/// How intervals are made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Bootstrap {
    /// How often the scenes are drawn again.
    pub draws: usize,
    /// Probability of the interval, in 0 to 1.
    pub level: f64,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for Bootstrap {
    fn default() -> Self {
        Self { draws: 10_000, level: 0.95, seed: 0 }
    }
}

impl Bootstrap {
    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] names the field and what it must be.
    pub fn validate(&self) -> Result<()> {
        let fault = |field, value: String, expected| Err(Error::Config { field, value, expected });
        if self.draws == 0 {
            return fault("draws", "0".to_owned(), "at least 1");
        }
        if !(self.level > 0.0 && self.level < 1.0) {
            return fault("level", self.level.to_string(), "a probability between 0 and 1");
        }
        Ok(())
    }

    /// The mean \\(\frac1n \sum_s x_s\\) over scenes.
    ///
    /// # Errors
    /// [`Error::Empty`] without scenes, [`Error::Value`] for a value that is not finite; as [`Bootstrap::validate`].
    pub fn mean(&self, values: &[f64]) -> Result<Estimate> {
        self.estimate("a mean", &[values], |[mean]| Some(*mean))?.ok_or(Error::Empty { what: "a mean" })
    }

    /// The paired difference \\(\frac1n \sum_s (x_s - r_s)\\) of a method's values and the reference's on the same scenes.
    ///
    /// # Errors
    /// As [`Bootstrap::mean`]; [`Error::Length`] where the lists differ.
    pub fn difference(&self, values: &[f64], reference: &[f64]) -> Result<Estimate> {
        let what = "a paired difference";
        self.estimate(what, &[values, reference], |[x, r]| Some(x - r))?.ok_or(Error::Empty { what })
    }

    /// The ratio of means \\(\sum_s x_s / \sum_s r_s\\) on the same scenes; nothing unless every drawn sum of the reference is positive.
    ///
    /// # Errors
    /// As [`Bootstrap::difference`].
    pub fn ratio(&self, values: &[f64], reference: &[f64]) -> Result<Option<Estimate>> {
        self.estimate("a ratio", &[values, reference], |[x, r]| (*r > 0.0).then_some(x / r))
    }

    /// `of` the means of the lists over the scenes, and over scenes drawn with replacement.
    fn estimate<const N: usize>(
        &self,
        what: &'static str,
        lists: &[&[f64]; N],
        of: impl Fn(&[f64; N]) -> Option<f64>,
    ) -> Result<Option<Estimate>> {
        self.validate()?;
        let count = lists.first().map_or(0, |list| list.len());
        for list in lists {
            if list.len() != count {
                return Err(Error::Length { what, found: list.len(), expected: count });
            }
            if let Some(index) = list.iter().position(|v| !v.is_finite()) {
                return Err(Error::Value { what, index, value: list[index], expected: "finite" });
            }
        }
        if count == 0 {
            return Err(Error::Empty { what });
        }
        let means = |scenes: &mut dyn FnMut() -> usize| {
            let mut sums = [0.0; N];
            for _ in 0..count {
                let scene = scenes();
                sums.iter_mut().zip(lists).for_each(|(sum, list)| *sum += list[scene]);
            }
            sums.map(|sum| sum / count as f64)
        };
        let mut in_order = 0..count;
        let Some(value) = of(&means(&mut || in_order.next().unwrap_or(0))) else { return Ok(None) };
        let mut drawn = Vec::with_capacity(self.draws);
        for draw in 0..self.draws {
            // The same scenes for every method and metric.
            let mut rng = CounterRng::new(self.seed, "bootstrap", draw as u64, 0);
            let Some(value) = of(&means(&mut || rng.random_range(0..count))) else { return Ok(None) };
            drawn.push(value);
        }
        drawn.sort_unstable_by(f64::total_cmp);
        let tail = 0.5 * (1.0 - self.level);
        let end = |p| quantile_sorted(&drawn, p).unwrap_or(value);
        Ok(Some(Estimate { value, low: end(tail), high: end(1.0 - tail) }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scenes() -> impl Strategy<Value = Vec<(f64, f64)>> {
        proptest::collection::vec((0.1..5.0_f64, 0.1..5.0_f64), 1..30)
    }

    const QUICK: Bootstrap = Bootstrap { draws: 500, level: 0.9, seed: 3 };

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn pairing_cancels_what_is_common(scenes in scenes(), shift in -3.0..3.0_f64, gain in 0.5..2.0_f64) {
            let reference: Vec<f64> = scenes.iter().map(|s| s.1).collect();
            let moved: Vec<f64> = reference.iter().map(|r| r + shift).collect();
            let d = QUICK.difference(&moved, &reference).unwrap();
            prop_assert!([d.value, d.low, d.high].iter().all(|v| (v - shift).abs() < 1e-12));
            let scaled: Vec<f64> = reference.iter().map(|r| r * gain).collect();
            let r = QUICK.ratio(&scaled, &reference).unwrap().unwrap();
            prop_assert!([r.value, r.low, r.high].iter().all(|v| (v - gain).abs() < 1e-12));
        }

        #[test]
        fn exchanging_the_methods_turns_the_interval_round(scenes in scenes()) {
            let (x, r): (Vec<f64>, Vec<f64>) = scenes.into_iter().unzip();
            let (forth, back) = (QUICK.difference(&x, &r).unwrap(), QUICK.difference(&r, &x).unwrap());
            prop_assert!((forth.low + back.high).abs() < 1e-12 && (forth.high + back.low).abs() < 1e-12);
            prop_assert!(forth.low <= forth.high);
        }
    }

    #[test]
    fn the_interval_of_a_mean_is_as_wide_as_theory_says() {
        let values: Vec<f64> = (0..50).map(|i| f64::from(i % 2)).collect();
        let mean = Bootstrap::default().mean(&values).unwrap();
        let half = 1.96 * 0.5 / 50_f64.sqrt();
        assert_eq!(mean.value, 0.5);
        assert!((mean.high - 0.5 - half).abs() < 0.015 && (0.5 - mean.low - half).abs() < 0.015, "{mean:?}");
        assert!(mean.excludes(0.3) && !mean.excludes(0.5));
    }

    #[test]
    fn the_interval_covers_as_often_as_it_says() {
        let mut inside = 0;
        for trial in 0..400 {
            let mut rng = CounterRng::new(9, "coverage", trial, 0);
            let values: Vec<f64> = (0..40).map(|_| rng.random_range(0.0..1.0)).collect();
            inside += u32::from(!QUICK.mean(&values).unwrap().excludes(0.5));
        }
        // Four standard errors about 90 %.
        assert!((336..=384).contains(&inside), "{inside}");
    }

    #[test]
    fn faults_are_named() {
        assert!(matches!(QUICK.mean(&[]), Err(Error::Empty { .. })));
        assert!(matches!(QUICK.mean(&[1.0, f64::NAN]), Err(Error::Value { index: 1, .. })));
        assert!(matches!(QUICK.difference(&[1.0], &[]), Err(Error::Length { .. })));
        assert!(QUICK.ratio(&[1.0], &[0.0]).unwrap().is_none());
        assert!(matches!(Bootstrap { draws: 0, ..QUICK }.mean(&[1.0]), Err(Error::Config { .. })));
    }
}
