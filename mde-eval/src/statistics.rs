//! Means, paired differences and ratios over scenes, with intervals.
//!
//! Scenes are the sample, not pixels: the errors of the pixels of one image are correlated. A method is compared with a
//! reference *on the same scenes*, so that what makes a scene hard cancels, and the interval is the percentile bootstrap
//! (Efron, 1979): scenes are drawn with replacement, both methods' values with them. The errors of several scenes of one room
//! are correlated too: whole places are drawn with replacement, all their scenes
//! with them (the cluster bootstrap; Davison and Hinkley, "Bootstrap methods and their application", 1997, Section 3.8).

use crate::error::{List, check, check_lists};
use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::quantile_sorted;
use rand::RngExt;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A number and its interval.
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
    /// Whether `value` lies outside the interval: whether the difference is beyond the chance of the scenes.
    pub fn excludes(&self, value: f64) -> bool {
        value < self.low || value > self.high
    }
}

/// Settings of the intervals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Bootstrap {
    /// Number of resamples.
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
    /// [`Error::Config`] for the first field at fault.
    pub fn validate(&self) -> Result<()> {
        let level = self.level > 0.0 && self.level < 1.0;
        check([
            ("draws", self.draws as f64, self.draws > 0, "use at least 1"),
            ("level", self.level, level, "use a probability between 0 and 1"),
        ])
    }

    /// The paired difference \\(\frac1n \sum_s (x_s - r_s)\\) of a method's values and the reference's on the same scenes. `places` has
    /// the label of each scene's place.
    ///
    /// # Errors
    /// [`Error::Empty`] without scenes, [`Error::Value`] for a value that is not finite, [`Error::Length`] where the lists or
    /// `places` differ; as [`Bootstrap::validate`].
    pub fn difference<P: Ord>(&self, values: &[f64], reference: &[f64], places: &[P]) -> Result<Estimate> {
        let what = "a paired difference";
        self.estimate(what, [values, reference], places, |[x, r]| Some(x - r))?.ok_or(Error::Empty(what))
    }

    /// The ratio of means \\(\sum_s x_s / \sum_s r_s\\) on the same scenes; `None` unless every drawn sum of the reference is positive.
    ///
    /// # Errors
    /// As [`Bootstrap::difference`].
    pub fn ratio<P: Ord>(&self, values: &[f64], reference: &[f64], places: &[P]) -> Result<Option<Estimate>> {
        self.estimate("a ratio", [values, reference], places, |[x, r]| (r > 0.0).then_some(x / r))
    }

    /// `of` the means of the lists over the scenes, and over the scenes of places drawn with replacement.
    fn estimate<P: Ord>(
        &self,
        what: &'static str,
        lists: [&[f64]; 2],
        places: &[P],
        of: impl Fn([f64; 2]) -> Option<f64>,
    ) -> Result<Option<Estimate>> {
        self.validate()?;
        check_lists(what, lists.map(|list| -> List<'_> { (what, list, f64::is_finite, "finite") }))?;
        if places.len() != lists[0].len() {
            return Err(Error::Length { what, found: places.len(), expected: lists[0].len() });
        }
        let mut scenes_of = BTreeMap::<&P, Vec<usize>>::new();
        for (scene, place) in places.iter().enumerate() {
            scenes_of.entry(place).or_default().push(scene);
        }
        let mut places: Vec<Vec<usize>> = scenes_of.into_values().collect();
        // In the order of their first scene.
        places.sort_unstable();
        let of_places = |drawn: &mut dyn Iterator<Item = usize>| {
            let (mut sums, mut scenes) = ([0.0; 2], 0_usize);
            for &scene in drawn.flat_map(|place| &places[place]) {
                sums.iter_mut().zip(lists).for_each(|(sum, list)| *sum += list[scene]);
                scenes += 1;
            }
            of(sums.map(|sum| sum / scenes as f64))
        };
        let count = places.len();
        let Some(value) = of_places(&mut (0..count)) else { return Ok(None) };
        let drawn = (0..self.draws).map(|draw| {
            // The same places for every method and metric.
            let mut rng = CounterRng::new(self.seed, "bootstrap", draw as u64, 0);
            of_places(&mut std::iter::repeat_with(|| rng.random_range(0..count)).take(count))
        });
        let Some(mut drawn) = drawn.collect::<Option<Vec<f64>>>() else { return Ok(None) };
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

    fn mean(values: &[f64], places: &[usize]) -> Result<Estimate> {
        QUICK.difference(values, &vec![0.0; values.len()], places)
    }

    /// Each scene in a place of its own.
    fn apart(values: &[f64]) -> Vec<usize> {
        (0..values.len()).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn pairing_cancels_what_is_common(scenes in scenes(), shift in -3.0..3.0_f64, gain in 0.5..2.0_f64) {
            let reference: Vec<f64> = scenes.iter().map(|s| s.1).collect();
            let moved: Vec<f64> = reference.iter().map(|r| r + shift).collect();
            let d = QUICK.difference(&moved, &reference, &apart(&moved)).unwrap();
            prop_assert!([d.value, d.low, d.high].iter().all(|v| (v - shift).abs() < 1e-12));
            let scaled: Vec<f64> = reference.iter().map(|r| r * gain).collect();
            let r = QUICK.ratio(&scaled, &reference, &apart(&scaled)).unwrap().unwrap();
            prop_assert!([r.value, r.low, r.high].iter().all(|v| (v - gain).abs() < 1e-12));
        }

        #[test]
        fn exchanging_the_methods_turns_the_interval_round(scenes in scenes()) {
            let (x, r): (Vec<f64>, Vec<f64>) = scenes.into_iter().unzip();
            let places = apart(&x);
            let (forth, back) = (QUICK.difference(&x, &r, &places).unwrap(), QUICK.difference(&r, &x, &places).unwrap());
            prop_assert!((forth.low + back.high).abs() < 1e-12 && (forth.high + back.low).abs() < 1e-12);
            prop_assert!(forth.low <= forth.high);
        }

        /// Copies of a scene in its own place bring no evidence.
        #[test]
        fn copies_within_a_place_leave_the_interval(scenes in scenes(), copies in 1..5_usize) {
            let values: Vec<f64> = scenes.iter().map(|scene| scene.0).collect();
            let repeated: Vec<f64> = values.iter().flat_map(|v| std::iter::repeat_n(*v, copies)).collect();
            let labels: Vec<usize> = (0..repeated.len()).map(|scene| scene / copies).collect();
            let (once, often) = (mean(&values, &apart(&values)).unwrap(), mean(&repeated, &labels).unwrap());
            for (a, b) in [(once.value, often.value), (once.low, often.low), (once.high, often.high)] {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }

    /// Three scenes to a place that are alike up to little noise: resampling scenes would cover about 60 %.
    #[test]
    fn the_interval_covers_as_often_as_it_says_where_scenes_of_a_place_are_alike_too() {
        let labels: Vec<usize> = (0..90).map(|scene| scene % 30).collect();
        let (mut of_places, mut of_scenes, mut alone) = (0, 0, 0);
        for trial in 0..400 {
            let mut rng = CounterRng::new(9, "places", trial, 0);
            let places: Vec<f64> = (0..30).map(|_| rng.random_range(0.0..1.0)).collect();
            let values: Vec<f64> =
                labels.iter().map(|place| places[*place] + rng.random_range(-0.05..0.05)).collect();
            of_places += u32::from(!mean(&values, &labels).unwrap().excludes(0.5));
            of_scenes += u32::from(!mean(&values, &apart(&values)).unwrap().excludes(0.5));
            alone += u32::from(!mean(&places, &apart(&places)).unwrap().excludes(0.5));
        }
        // Four standard errors about 89 %, which the percentile bootstrap has with 30 places.
        assert!((331..=384).contains(&of_places) && (331..=384).contains(&alone), "{of_places} {alone}");
        assert!(of_scenes < 300, "{of_scenes}");
    }

    #[test]
    fn faults_are_named() {
        assert!(matches!(mean(&[1.0, 2.0], &[0]), Err(Error::Length { found: 1, .. })));
        assert!(matches!(mean(&[], &[]), Err(Error::Empty(_))));
        assert!(matches!(mean(&[1.0, f64::NAN], &[0, 1]), Err(Error::Value { index: 1, .. })));
        assert!(matches!(QUICK.difference(&[1.0], &[], &[0]), Err(Error::Length { .. })));
        assert!(QUICK.ratio(&[1.0], &[0.0], &[0]).unwrap().is_none());
        let none = Bootstrap { draws: 0, ..QUICK };
        assert!(matches!(none.difference(&[1.0], &[0.0], &[0]), Err(Error::Config(_))));
    }
}
