//! Intervals of a stated probability: half widths in units of sigma, from the errors on scenes of known depth.
//!
//! The pixels of one scene err together, so the scene is the unit. With \\(F_s\\) the distribution function of \\(|e| / \sigma\\) over the
//! pixels of scene \\(s\\), the half width of probability \\(p\\) is where the *mean of the scenes' distribution functions* reaches it,
//!
//! \\[ \frac1S \sum_{s=1}^{S} F_s(q_p) = p : \\]
//!
//! CDF pooling (Dunn, Wasserman and Ramdas, "Distribution-free prediction sets for two-layer hierarchical models", JASA, 2023).
//! The coverage of a new scene, averaged over scenes like these, tends to \\(p\\) as \\(S\\) grows. It is not split conformal
//! prediction: no coverage is guaranteed for finite \\(S\\), for which the level would have to be \\(p\\,(S+1)/S\\) (Lee, Barber and
//! Willett, "Distribution-free inference with hierarchical data", 2023), and on a single scene the coverage can be far from
//! \\(p\\). [`held_out`] measures both.
//!
//! A scene is given by the quantiles of \\(|e| / \sigma\\) at equal steps of probability, \\(0, 1/m, \dots, 1\\).

use crate::normal::{central_half_width, erf};
use crate::{OutOfRange, Result};
use std::f64::consts::FRAC_1_SQRT_2;

/// Half widths of central intervals, in sigmas, by their probability.
#[derive(Debug, Clone, PartialEq)]
pub struct PooledIntervals {
    /// At the probabilities \\(0, 0.01, \dots, 0.99\\); non-decreasing.
    pub(crate) half_widths: Vec<f64>,
}

impl PooledIntervals {
    /// Number of probabilities in the table.
    pub const STEPS: usize = 100;

    /// The table of `scenes`, each the quantiles of \\(|e| / \sigma\\) at equal steps of probability from 0 to 1. Scenes weigh alike.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) without scenes, for a scene of fewer than two quantiles, and for quantiles that decrease, are negative
    /// or not finite.
    pub fn fit(scenes: &[Vec<f64>]) -> Result<Self> {
        let remedy = "give one scene or more with an uncertainty";
        OutOfRange::check(!scenes.is_empty(), "scenes", &"an empty list", remedy)?;
        if let Some(scene) = scenes.iter().position(|q| q.len() < 2 || !rises(q)) {
            let remedy = "give two or more finite numbers from 0 on that do not decrease";
            let value = format!("unusable for scene {scene}");
            return Err(OutOfRange::new("the list of |e| / sigma", value, remedy).into());
        }
        let steps = Self::STEPS as f64;
        let half_width = |step: usize| pooled_quantile(scenes, step as f64 / steps);
        Self::from_half_widths((0..Self::STEPS).map(half_width).collect())
    }

    /// The table with these half widths in sigmas, at the probabilities \\(0, 0.01, \dots, 0.99\\).
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) unless there are [`STEPS`](Self::STEPS) of them, finite, at least 0, non-decreasing, and the last above 0.
    pub fn from_half_widths(half_widths: Vec<f64>) -> Result<Self> {
        let positive = half_widths.last().is_some_and(|last| *last > 0.0);
        let sound = half_widths.len() == Self::STEPS && positive && rises(&half_widths);
        let value = format!("a list of {} unusable values", half_widths.len());
        let remedy = "give 100 finite numbers from 0 on that do not decrease, the last above 0";
        OutOfRange::check(sound, "half-widths", &value, remedy)?;
        Ok(Self { half_widths })
    }

    /// Half the width of the central interval of probability `p`, in sigmas; linear between the table's entries.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) unless `p` is within 0.01 and 0.99, the range of the table.
    pub fn half_width(&self, p: f64) -> Result<f64> {
        check(p)?;
        let place = p * Self::STEPS as f64;
        let at = |step: usize| self.half_widths.get(step).or(self.half_widths.last()).copied().unwrap_or(0.0);
        let below = at(place as usize);
        Ok(below + place.fract() * (at(place as usize + 1) - below))
    }

    /// The factor on sigma that gives a normal distribution's central interval of probability `p` the table's half width.
    ///
    /// # Errors
    /// As [`half_width`](Self::half_width).
    pub fn factor(&self, p: f64) -> Result<f64> {
        Ok(self.half_width(p)? / central_half_width(p))
    }
}

/// A distribution of the errors over their sigmas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tails {
    /// The normal distribution.
    Normal,
    /// Student's t of two degrees of freedom, whose central interval of probability .9 is as wide as the normal one.
    Heavy,
}

impl Tails {
    /// Student's t of two degrees of freedom: half its width over \\( p / \sqrt{1 - p^2} \\).
    const HEAVY: f64 = 0.796_638_970_755_312_5;

    /// Half the width of the central interval of probability `p`, in sigmas; of heavy tails \\( c p / \sqrt{1 - p^2} \\).
    ///
    /// # Errors
    /// As [`PooledIntervals::half_width`].
    pub fn half_width(self, p: f64) -> Result<f64> {
        check(p)?;
        Ok(match self {
            Self::Normal => central_half_width(p),
            Self::Heavy => Self::HEAVY * p / (1.0 - p * p).sqrt(),
        })
    }

    /// The probability of an error below that many sigmas, at least 0; of heavy tails \\( x / \sqrt{x^2 + c^2} \\).
    pub fn within(self, sigmas: f64) -> f64 {
        match self {
            Self::Normal => erf(sigmas * FRAC_1_SQRT_2),
            Self::Heavy => sigmas / sigmas.hypot(Self::HEAVY),
        }
    }
}

/// For each scene, the share of its pixels inside the interval of probability `p` of all *other* scenes; `None` for fewer than two scenes.
///
/// # Errors
/// As [`PooledIntervals::fit`] and [`PooledIntervals::half_width`].
pub fn held_out(scenes: &[Vec<f64>], p: f64) -> Result<Option<Vec<f64>>> {
    if scenes.len() < 2 {
        return Ok(None);
    }
    let covered = |left_out: usize| {
        let mut others = scenes.to_vec();
        let own = others.swap_remove(left_out);
        Ok(share_below(&own, PooledIntervals::fit(&others)?.half_width(p)?))
    };
    (0..scenes.len()).map(covered).collect::<Result<_>>().map(Some)
}

/// Where the mean of the scenes' distribution functions reaches `p`, by bisection.
fn pooled_quantile(scenes: &[Vec<f64>], p: f64) -> f64 {
    let covered = |z: f64| scenes.iter().map(|q| share_below(q, z)).sum::<f64>() / scenes.len() as f64;
    let mut high = scenes.iter().filter_map(|q| q.last()).copied().fold(0.0, f64::max);
    let mut low = 0.0;
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if covered(middle) < p { low = middle } else { high = middle }
    }
    high
}

/// The distribution function at `value` of a scene given by its quantiles; linear between them.
pub fn share_below(quantiles: &[f64], value: f64) -> f64 {
    let steps = quantiles.len().saturating_sub(1).max(1) as f64;
    match quantiles.partition_point(|q| *q <= value) {
        0 => 0.0,
        above if above == quantiles.len() => 1.0,
        above => {
            let (low, high) = (quantiles[above - 1], quantiles[above]);
            (above as f64 - 1.0 + (value - low) / (high - low)) / steps
        }
    }
}

fn check(p: f64) -> Result<()> {
    let sound = (0.01..=0.99).contains(&p);
    Ok(OutOfRange::check(sound, "the probability of an interval", &p, "give one from 0.01 to 0.99")?)
}

fn rises(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite() && *v >= 0.0) && values.is_sorted()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::proptest::collection::vec;
    use ::proptest::prelude::*;

    /// Quantiles of |z| where sigma is too small by the factor `by`.
    fn normal(by: f64) -> Vec<f64> {
        (0..=100).map(|k| by * central_half_width((f64::from(k) / 100.0).min(0.9999))).collect()
    }

    #[test]
    fn exact_sigmas_have_the_factor_one() {
        let table = PooledIntervals::fit(&[normal(1.0), normal(1.0)]).unwrap();
        for p in [0.1, 0.5, 0.9, 0.99] {
            assert!((table.factor(p).unwrap() - 1.0).abs() < 1e-3, "{p}: {}", table.factor(p).unwrap());
        }
    }

    /// A normal error over the root of an exponential one has those tails; 90 % of such errors are less than 2.92.
    #[test]
    fn heavy_intervals_hold_their_share_of_such_errors() {
        let middles = || (0..200).map(|k| (f64::from(k) + 0.5) / 200.0);
        let ratios = middles().flat_map(|u| middles().map(move |v| central_half_width(u) / (-v.ln()).sqrt()));
        let errors: Vec<f64> = ratios.collect();
        for p in [0.3, 0.5, 0.9, 0.98] {
            let width =
                2.919_986 * Tails::Heavy.half_width(p).unwrap() / Tails::Normal.half_width(0.9).unwrap();
            let held = errors.iter().filter(|error| **error < width).count() as f64 / errors.len() as f64;
            assert!((held - p).abs() < 2e-3, "{held} for {p}");
            for tails in [Tails::Normal, Tails::Heavy] {
                assert!((tails.within(tails.half_width(p).unwrap()) - p).abs() < 1e-12);
            }
        }
        let [normal, heavy] = [Tails::Normal, Tails::Heavy].map(|tails| tails.half_width(0.9).unwrap());
        assert!((heavy / normal - 1.0).abs() < 1e-12);
    }

    #[test]
    fn unusable_tables_and_probabilities_are_refused() {
        for scene in [vec![1.0], vec![0.0, f64::NAN], vec![2.0, 1.0]] {
            assert!(PooledIntervals::fit(&[scene]).is_err());
        }
        assert!(PooledIntervals::fit(&[]).is_err());
        for half_widths in [vec![1.0; 99], vec![0.0; 100]] {
            assert!(PooledIntervals::from_half_widths(half_widths).is_err());
        }
        let table = PooledIntervals::from_half_widths(vec![1.0; 100]).unwrap();
        assert!([0.0, 1.0, -0.5, f64::NAN].iter().all(|p| table.half_width(*p).is_err()));
        assert_eq!(held_out(&[normal(1.0)], 0.9).unwrap(), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_mean_coverage_of_the_scenes_is_the_stated_one(by in vec(0.2..5.0_f64, 1..12), p in 0.05..0.95_f64) {
            let scenes: Vec<_> = by.iter().map(|by| normal(*by)).collect();
            let width = PooledIntervals::fit(&scenes).unwrap().half_width(p).unwrap();
            let mean = scenes.iter().map(|q| share_below(q, width)).sum::<f64>() / scenes.len() as f64;
            // Between hundredths the table is a chord.
            prop_assert!((mean - p).abs() < 0.011, "{mean} for {p}");
        }
    }

    /// Half of what is uniform up to 4 lies below 2, which is two thirds of what is uniform up to 3; half of that lies below 1.5.
    #[test]
    fn held_out_coverage_is_that_by_the_other_scenes() {
        let covered = held_out(&[vec![0.0, 3.0], vec![0.0, 4.0]], 0.5).unwrap().unwrap();
        assert!((covered[0] - 2.0 / 3.0).abs() < 1e-9 && (covered[1] - 0.375).abs() < 1e-9, "{covered:?}");
    }
}
