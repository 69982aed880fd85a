//! How probable it is that a match is right.

use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Zip};

use super::Agreement;
use crate::Result;
use crate::sweep::Sweep;

/// Matches of at most this probability are not used to correct a prior.
pub(super) const TRUSTED: f32 = 0.5;

/// Coefficients of [`chances`]: constant, log odds of the posterior mass, per visible photograph that does not agree, none
/// agrees, cost. A logistic regression of "within 10 % of the truth" over 11 indoor captures.
const CHANCE: [f32; 5] = [1.2, 0.3, -0.4, -1.4, -1.3];
/// Photographs beside the reference in those captures at most; of more, the share that does not agree counts as one of so many.
const PHOTOGRAPHS: f32 = 6.0;

/// Probability that a match is right, from its posterior mass, its cost and the other photographs. One that no other photograph
/// confirms is not trusted: the coefficients are of four photographs and more, several of which contradict a wrong match.
pub(super) fn chances(sweep: &Sweep, agreement: &Agreement) -> Array2<f32> {
    let chance = |&mass: &f32, &cost: &f32, &agree: &u8, &visible: &u8| {
        // The best surface at either end is no match.
        if mass == 0.0 {
            return 0.0;
        }
        let odds = (mass.max(1e-3) / (1.0 - mass).max(0.02)).ln();
        let none = if agree == 0 { 1.0 } else { 0.0 };
        let share = (PHOTOGRAPHS / f32::from(visible.max(1))).min(1.0);
        let terms = [1.0, odds, share * f32::from(visible - agree), none, cost];
        let logit: f32 = CHANCE.iter().zip(terms).map(|(c, t)| c * t).sum();
        let chance = 1.0 / (1.0 + (-logit).exp());
        if agree == 0 { chance.min(TRUSTED) } else { chance }
    };
    let Agreement { agree, visible } = agreement;
    Zip::from(&sweep.inlier).and(&sweep.cost).and(agree).and(visible).map_collect(chance)
}

/// The more probable of two matches per pixel; the second only where the first is not trusted.
pub(super) fn better(
    first: &Sweep,
    first_chance: &Array2<f32>,
    second: &Sweep,
    second_chance: &Array2<f32>,
) -> Result<(Sweep, Array2<f32>)> {
    let mut best = first.clone();
    let mut chance = first_chance.clone();
    let (mut mean, mut variance) = best.depth.into_parts();
    for (at, c) in chance.indexed_iter_mut() {
        if *c <= TRUSTED && second_chance[at] > TRUSTED {
            *c = second_chance[at];
            mean[at] = second.depth.mean()[at];
            variance[at] = second.depth.variance()[at];
            best.inlier[at] = second.inlier[at];
            best.cost[at] = second.cost[at];
        }
    }
    best.depth = GaussianDepth::new(mean, variance)?;
    Ok((best, chance))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use ndarray::array;

    /// A sweep of one depth and variance, with the full mass and no cost.
    pub(in crate::sweep) fn sure(shape: (usize, usize), depth: f32, variance: f32) -> Sweep {
        let [mean, variance, inlier, cost] =
            [depth, variance, 1.0, 0.0].map(|value| Array2::from_elem(shape, value));
        Sweep { depth: GaussianDepth::new(mean, variance).unwrap(), inlier, cost, surfaces: 8 }
    }

    /// A match of full mass and no cost, that one of two photographs confirms or none.
    #[test]
    fn a_match_that_no_photograph_confirms_is_not_trusted() {
        let agreement = Agreement { agree: array![[1, 0]], visible: array![[1, 1]] };
        let found = chances(&sure((1, 2), 1.0, 1.0), &agreement);
        assert!(found[(0, 0)] > 0.9, "{}", found[(0, 0)]);
        assert!(found[(0, 1)] <= TRUSTED && found[(0, 1)] > 0.0, "{}", found[(0, 1)]);
    }

    /// Where two in three photographs agree, thirty are no less reason to trust than six.
    #[test]
    fn more_photographs_of_which_as_many_agree_are_trusted_as_much() {
        let agreement = Agreement { agree: array![[4, 20]], visible: array![[6, 30]] };
        let found = chances(&sure((1, 2), 1.0, 1.0), &agreement);
        assert!((found[(0, 0)] - found[(0, 1)]).abs() < 1e-6, "{found}");
    }
}
