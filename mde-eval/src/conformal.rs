//! Intervals that hold: half widths in units of sigma, learned on scenes whose depth is known.
//!
//! Split conformal prediction with the score \\(|e| / \sigma\\) (Angelopoulos and Bates, "A gentle introduction to conformal
//! prediction", 2021, Section 2.3.2), but pixels of one photograph err together, so the unit is the scene: the half width of
//! probability \\(p\\) is where the mean of the scenes' distribution functions reaches \\(p\\). It holds on average over
//! scenes like these; on one scene it can be far off, which [`held_out`] shows.

use crate::special::central_half_width;
use crate::statistics::{pooled_quantile, share_below};
use crate::{Error, Result};

/// Half widths of central intervals by their probability.
#[derive(Debug, Clone, PartialEq)]
pub struct Conformal {
    /// In sigmas, at the probabilities \\(0, 0.01, \dots, 0.99\\); they never fall.
    half_widths: Vec<f64>,
}

impl Conformal {
    /// Probabilities that a table has.
    pub const STEPS: usize = 100;

    /// The table that `scenes` give: for each, the quantiles of \\(|e| / \sigma\\) at equal steps of probability from 0 to 1, as
    /// [`UncertaintyCurves::abs_z_quantiles`](crate::score::UncertaintyCurves::abs_z_quantiles) has them. Scenes weigh alike.
    ///
    /// # Errors
    /// [`Error::Config`] without scenes, for a scene of fewer than two quantiles, and for quantiles that fall, are negative
    /// or not finite.
    pub fn fit(scenes: &[Vec<f64>]) -> Result<Self> {
        if scenes.is_empty() {
            return Err(fault("scenes", "an empty list".to_owned(), "one or more that have an uncertainty"));
        }
        if let Some(scene) = scenes.iter().position(|q| q.len() < 2 || !rises(q)) {
            let value = format!("unfit for scene {scene}");
            return Err(fault(
                "the list of |e| / sigma",
                value,
                "two or more finite numbers from 0 that never fall",
            ));
        }
        let steps = Self::STEPS as f64;
        let half_width = |step: usize| pooled_quantile(scenes.iter(), step as f64 / steps);
        Self::from_half_widths((0..Self::STEPS).map(half_width).collect())
    }

    /// The table with these [half widths](Self::half_widths).
    ///
    /// # Errors
    /// [`Error::Config`] unless there are [`STEPS`](Self::STEPS) of them, 0 or more, finite, never falling, the last above 0.
    pub fn from_half_widths(half_widths: Vec<f64>) -> Result<Self> {
        let positive = half_widths.last().is_some_and(|last| *last > 0.0);
        if half_widths.len() != Self::STEPS || !positive || !rises(&half_widths) {
            let value = format!("unfit, with {} values", half_widths.len());
            return Err(fault(
                "half-widths",
                value,
                "100 finite numbers from 0 that never fall, the last above 0",
            ));
        }
        Ok(Self { half_widths })
    }

    /// In sigmas, at the probabilities \\(0, 0.01, \dots, 0.99\\).
    pub fn half_widths(&self) -> &[f64] {
        &self.half_widths
    }

    /// Half the width of the central interval of probability `p`, in sigmas; linear between the table's.
    ///
    /// # Errors
    /// [`Error::Config`] unless `p` is within 0.01 and 0.99: beyond, a table of hundredths says nothing.
    pub fn half_width(&self, p: f64) -> Result<f64> {
        check(p)?;
        let place = p * Self::STEPS as f64;
        let at = |step: usize| self.half_widths.get(step).or(self.half_widths.last()).copied().unwrap_or(0.0);
        let below = at(place as usize);
        Ok(below + place.fract() * (at(place as usize + 1) - below))
    }

    /// What every sigma is multiplied by, that a normal distribution's central interval of probability `p` holds.
    ///
    /// # Errors
    /// As [`half_width`](Self::half_width).
    pub fn factor(&self, p: f64) -> Result<f64> {
        Ok(self.half_width(p)? / central_half_width(p))
    }
}

/// Half the width of a normal distribution's central interval of probability `p`, in sigmas.
///
/// # Errors
/// As [`Conformal::half_width`].
pub fn normal_half_width(p: f64) -> Result<f64> {
    check(p)?;
    Ok(central_half_width(p))
}

/// What share of each scene the interval of probability `p` covers that the *other* scenes gave; nothing for fewer than two.
///
/// # Errors
/// As [`Conformal::fit`] and [`Conformal::half_width`].
pub fn held_out(scenes: &[Vec<f64>], p: f64) -> Result<Option<Vec<f64>>> {
    if scenes.len() < 2 {
        return Ok(None);
    }
    let covered = |left_out: usize| {
        let mut others = scenes.to_vec();
        let own = others.swap_remove(left_out);
        Ok(share_below(&own, Conformal::fit(&others)?.half_width(p)?))
    };
    (0..scenes.len()).map(covered).collect::<Result<_>>().map(Some)
}

fn check(p: f64) -> Result<()> {
    match p {
        0.01..=0.99 => Ok(()),
        _ => Err(fault("the probability of an interval", p.to_string(), "between 0.01 and 0.99")),
    }
}

fn fault(field: &'static str, value: String, expected: &'static str) -> Error {
    Error::Config { field, value, expected }
}

fn rises(values: &[f64]) -> bool {
    values.iter().all(|v| v.is_finite() && *v >= 0.0) && values.is_sorted()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// |z| of a normal distribution, too small a sigma by `by`.
    fn normal(by: f64) -> Vec<f64> {
        (0..=100).map(|k| by * central_half_width((f64::from(k) / 100.0).min(0.9999))).collect()
    }

    #[test]
    fn right_sigmas_need_no_factor() {
        let table = Conformal::fit(&[normal(1.0), normal(1.0)]).unwrap();
        for p in [0.1, 0.5, 0.9, 0.99] {
            assert!((table.factor(p).unwrap() - 1.0).abs() < 1e-3, "{p}: {}", table.factor(p).unwrap());
        }
        assert!((normal_half_width(0.9).unwrap() - 1.644_853_627).abs() < 1e-6);
    }

    #[test]
    fn what_is_no_table_is_refused() {
        assert!(Conformal::fit(&[]).is_err());
        assert!(Conformal::fit(&[vec![1.0]]).is_err());
        assert!(Conformal::fit(&[vec![0.0, f64::NAN]]).is_err());
        assert!(Conformal::fit(&[vec![2.0, 1.0]]).is_err());
        assert!(Conformal::from_half_widths(vec![1.0; 99]).is_err());
        assert!(Conformal::from_half_widths(vec![0.0; 100]).is_err());
        let table = Conformal::from_half_widths(vec![1.0; 100]).unwrap();
        assert!([0.0, 1.0, -0.5, f64::NAN].iter().all(|p| table.half_width(*p).is_err()));
        assert_eq!(held_out(&[normal(1.0)], 0.9).unwrap(), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn the_scenes_are_covered_on_average(by in proptest::collection::vec(0.2..5.0_f64, 1..12), p in 0.05..0.95_f64) {
            let scenes: Vec<_> = by.iter().map(|by| normal(*by)).collect();
            let width = Conformal::fit(&scenes).unwrap().half_width(p).unwrap();
            let mean = scenes.iter().map(|q| share_below(q, width)).sum::<f64>() / scenes.len() as f64;
            // Between hundredths the table is a chord.
            prop_assert!((mean - p).abs() < 0.011, "{mean} for {p}");
        }

        #[test]
        fn held_out_is_what_the_factors_of_the_others_cover(by in proptest::collection::vec(0.2..5.0_f64, 2..8)) {
            let scenes: Vec<_> = by.iter().map(|by| normal(*by)).collect();
            let covered = held_out(&scenes, 0.9).unwrap().unwrap();
            let factors = crate::statistics::leave_one_out_factors(&scenes, 0.9).unwrap();
            for ((scene, factor), covered) in scenes.iter().zip(factors).zip(covered) {
                prop_assert!((share_below(scene, factor * central_half_width(0.9)) - covered).abs() < 1e-9);
            }
        }
    }
}
