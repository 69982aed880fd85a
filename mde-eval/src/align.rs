//! Bringing a prediction to the truth's scale before it is scored.
//!
//! A monocular depth is known up to a scale, sometimes up to an affine map of its disparity. What is fitted decides the score, so an
//! [`AlignmentRule`] has a name that belongs beside every number, and a fitted [`Alignment`] is a value: fit one per map (*own*), or fit
//! the baseline's and apply it to every method (*shared*), so that a difference is not the alignment's.

use crate::error::{check_lists, positive};
use crate::{Error, Result};
use mde_uncertainty::statistics::median;
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};
use std::fmt;

/// How an [`Alignment`] is fitted to the pixels that count. Beside a score it stands as `none`, `median`, `median-ratio`, `ls-depth` or
/// `ls-disparity`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AlignmentRule {
    /// Nothing: the prediction is metric already.
    None,
    /// \\(s = \operatorname{median}(g) / \operatorname{median}(p)\\), in depth (Zhou et al., CVPR 2017; the paper's).
    Median,
    /// \\(s = \operatorname{median}(g / p)\\), in depth: pixels that change surface move it less than the ratio of medians.
    #[default]
    MedianRatio,
    /// \\((s, t) = \arg\min \sum_i (s p_i + t - g_i)^2\\), in depth (Marigold's `least_square`).
    LeastSquaresDepth,
    /// \\((s, t) = \arg\min \sum_i (s / p_i + t - 1 / g_i)^2\\), in disparity, with the aligned disparity kept at or above
    /// \\(1 / \max g\\) (MoGe's clamp) before it is inverted.
    LeastSquaresDisparity,
}

impl AlignmentRule {
    /// Its short name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Median => "median",
            Self::MedianRatio => "median-ratio",
            Self::LeastSquaresDepth => "ls-depth",
            Self::LeastSquaresDisparity => "ls-disparity",
        }
    }

    /// Fits the alignment of `prediction` to `truth`: the depths of the pixels that count, in any order.
    ///
    /// A prediction that cannot fix the parameters (all depths equal, for the two affine rules) is left as it is.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::Empty`] without pixels, [`Error::Value`] for a depth that is not positive and finite.
    pub fn fit(self, prediction: &[f64], truth: &[f64]) -> Result<Alignment> {
        check_lists(
            "an alignment",
            [positive("the true depth", truth), positive("the predicted depth", prediction)],
        )?;
        let empty = || Error::Empty("an alignment");
        Ok(match self {
            Self::None => Alignment::IDENTITY,
            Self::Median => {
                let of = |depths: &[f64]| median(depths.iter().copied()).ok_or_else(empty);
                Alignment::scale(of(truth)? / of(prediction)?)
            }
            Self::MedianRatio => {
                let ratios = truth.iter().zip(prediction).map(|(g, p)| g / p);
                Alignment::scale(median(ratios).ok_or_else(empty)?)
            }
            Self::LeastSquaresDepth => least_squares(prediction, truth)
                .map_or(Alignment::IDENTITY, |(scale, shift)| Alignment::Depth { scale, shift }),
            Self::LeastSquaresDisparity => {
                let inverse = |depths: &[f64]| depths.iter().map(|z| z.recip()).collect::<Vec<_>>();
                let floor = truth.iter().copied().fold(0.0, f64::max).recip();
                let (scale, shift) =
                    least_squares(&inverse(prediction), &inverse(truth)).unwrap_or((1.0, 0.0));
                Alignment::Disparity { scale, shift, floor: if floor.is_finite() { floor } else { 0.0 } }
            }
        })
    }
}

impl fmt::Display for AlignmentRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A fitted map from the prediction's depths to the truth's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "space", rename_all = "kebab-case")]
pub enum Alignment {
    /// \\(d = s\\,p + t\\).
    Depth {
        /// \\(s\\).
        scale: f64,
        /// \\(t\\), in the truth's unit.
        shift: f64,
    },
    /// \\(d = 1 / \max(s / p + t,\\; c)\\).
    Disparity {
        /// \\(s\\).
        scale: f64,
        /// \\(t\\), in one over the truth's unit.
        shift: f64,
        /// \\(c\\): the smallest disparity that is kept, in one over the truth's unit.
        floor: f64,
    },
}

impl Alignment {
    /// The alignment that changes nothing.
    pub const IDENTITY: Self = Self::scale(1.0);

    /// \\(d = s\\,p\\).
    pub const fn scale(scale: f64) -> Self {
        Self::Depth { scale, shift: 0.0 }
    }

    /// The aligned depth. An affine fit may turn a depth negative: clip before taking logarithms.
    pub fn depth(&self, prediction: f64) -> f64 {
        match *self {
            Self::Depth { scale, shift } => scale * prediction + shift,
            Self::Disparity { scale, shift, floor } => (scale / prediction + shift).max(floor).recip(),
        }
    }

    /// The aligned standard deviation of a prediction with standard deviation `sigma`: \\(|\partial d / \partial p|\\,\sigma\\).
    ///
    /// Exact for an affine map of depth; to first order for one of disparity, at the aligned depth.
    pub fn sigma(&self, prediction: f64, sigma: f64) -> f64 {
        match *self {
            Self::Depth { scale, .. } => scale.abs() * sigma,
            Self::Disparity { scale, .. } => {
                scale.abs() * (self.depth(prediction) / prediction).powi(2) * sigma
            }
        }
    }

    /// A whole map of depths `[height, width]`; pixels that are not positive and finite (missing) become 0.
    pub fn apply(&self, prediction: ArrayView2<'_, f32>) -> Array2<f32> {
        prediction.mapv(|p| if p > 0.0 && p.is_finite() { self.depth(f64::from(p)) as f32 } else { 0.0 })
    }
}

/// \\((s, t) = \arg\min \sum_i (s x_i + t - y_i)^2\\) about the means; nothing where all \\(x_i\\) are equal.
///
/// The same minimum as the normal equations of MiDaS's `compute_scale_and_shift`, without their cancellation.
fn least_squares(x: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let n = x.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / n;
    let (x_mean, y_mean) = (mean(x), mean(y));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        xx += (x - x_mean).powi(2);
        xy += (x - x_mean) * (y - y_mean);
    }
    // Spread below rounding is no spread.
    let spread = xx > n * (1e-12 * x_mean).powi(2);
    let scale = xy / xx;
    (spread && scale.is_finite()).then_some((scale, y_mean - scale * x_mean))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    const AFFINE: [AlignmentRule; 2] =
        [AlignmentRule::LeastSquaresDepth, AlignmentRule::LeastSquaresDisparity];

    fn depths() -> impl Strategy<Value = Vec<f64>> {
        proptest::collection::vec(0.5..10.0_f64, 3..40)
    }

    proptest! {
        #[test]
        fn a_scaled_truth_is_recovered_by_every_rule(truth in depths(), scale in 0.1..10.0_f64) {
            let scaled: Vec<f64> = truth.iter().map(|g| g / scale).collect();
            for rule in [AlignmentRule::Median, AlignmentRule::MedianRatio, AFFINE[0], AFFINE[1]] {
                let fitted = rule.fit(&scaled, &truth).unwrap();
                for (&p, &g) in scaled.iter().zip(&truth) {
                    assert_relative_eq!(fitted.depth(p), g, max_relative = 1e-9);
                    assert_relative_eq!(fitted.sigma(p, 0.1), 0.1 * scale, max_relative = 1e-6);
                }
            }
        }

        #[test]
        fn an_affine_truth_is_recovered_in_its_space(truth in depths(), s in 0.2..5.0_f64, t in 0.0..3.0_f64) {
            let in_depth: Vec<f64> = truth.iter().map(|g| s * g + t).collect();
            let in_disparity: Vec<f64> = truth.iter().map(|g| 1.0 / (s / g + t)).collect();
            for (rule, prediction) in [(AFFINE[0], in_depth), (AFFINE[1], in_disparity)] {
                let fitted = rule.fit(&prediction, &truth).unwrap();
                for (&p, &g) in prediction.iter().zip(&truth) {
                    assert_relative_eq!(fitted.depth(p), g, max_relative = 1e-6);
                }
            }
        }
    }

    #[test]
    fn a_constant_prediction_is_left_alone() {
        for rule in AFFINE {
            assert_relative_eq!(rule.fit(&[2.0; 5], &[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap().depth(2.0), 2.0);
        }
    }

    #[test]
    fn the_clamp_keeps_aligned_depths_within_the_truth() {
        let fitted = AFFINE[1].fit(&[1.0, 2.0, 50.0], &[1.0, 2.0, 3.0]).unwrap();
        assert!(fitted.depth(1e9) <= 3.0 + 1e-12);
    }

    #[test]
    fn missing_pixels_stay_missing() {
        let map = ndarray::array![[0.0, f32::NAN, 2.0]];
        let alignment = Alignment::Depth { scale: 2.0, shift: 1.0 };
        assert_eq!(alignment.apply(map.view()), ndarray::array![[0.0, 0.0, 5.0]]);
    }
}
