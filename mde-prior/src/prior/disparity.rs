use mde_uncertainty::OutOfRange;
use mde_uncertainty::statistics::quantile_sorted;
use ndarray::{Array2, ArrayView2, Zip};
use serde::{Deserialize, Serialize};

use crate::error::same_size;
use crate::{Error, Result};

/// The rule that turns disparity of unknown scale and shift into positive depth.
///
/// A model of the MiDaS family gives `d` with \\( 1/z = a d + b \\) for unknown `a > 0` and `b`: `1/d` is no depth, not even up to scale,
/// and `d` may be negative. The rule states the depth range instead: with `q` the quantiles of the map's valid values,
///
/// \\[ \hat d = \mathrm{clip}\Bigl(\frac{d - q_{lo}}{q_{hi} - q_{lo}}, 0, 1\Bigr), \qquad
///    \frac1z = A \hat d + B, \quad A = \frac1{z_{near}} - \frac1{z_{far}}, \quad B = \frac1{z_{far}}. \\]
///
/// So `near <= z <= far` always, depth falls as disparity grows, and the result does not change when the map is multiplied by a positive
/// number or shifted. A constant map becomes the depth in the middle of the disparity range, \\( 2 / (1/z_{near} + 1/z_{far}) \\). Where
/// more than `high - low` of a map is one single value, its extremes take the place of the quantiles.
///
/// ```
/// use mde_prior::DisparityRule;
/// use mde_prior::ndarray::array;
///
/// let rule = DisparityRule { near: 1.0, far: 4.0, low: 0.0, high: 1.0 };
/// let z = rule.depth(array![[-3.0, 0.0, 3.0]].view(), array![[true, true, true]].view())?;
/// assert_eq!(z, array![[4.0, 1.6, 1.0]]);
/// # Ok::<(), mde_prior::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct DisparityRule {
    /// Depth of the largest disparity, positive; 0.8 suits a room in metres.
    pub near: f64,
    /// Depth of the smallest disparity, above `near`; 8.
    pub far: f64,
    /// Quantile taken as the smallest disparity, in `[0, 1]`; 0.005. Not part of a configuration file.
    #[serde(skip)]
    pub low: f64,
    /// Quantile taken as the largest disparity, in `(low, 1]`; 0.995. Not part of a configuration file.
    #[serde(skip)]
    pub high: f64,
}

impl Default for DisparityRule {
    fn default() -> Self {
        Self { near: 0.8, far: 8.0, low: 0.005, high: 0.995 }
    }
}

/// Below this share of the largest magnitude a spread of `f32` values is rounding, not signal.
const CONSTANT: f64 = 1e-6;

impl DisparityRule {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] that names the field.
    pub fn validate(&self) -> Result<()> {
        let check = OutOfRange::check;
        let Self { near, far, low, high } = *self;
        let positive = near.is_finite() && near >= f64::from(f32::MIN_POSITIVE);
        check(positive, "disparity.near", &near, "give the nearest depth of the scene, above 0")?;
        let farther = far > near && far <= f64::from(f32::MAX);
        check(farther, "disparity.far", &far, "give the farthest depth of the scene, above disparity.near")?;
        check((0.0..1.0).contains(&low), "disparity.low", &low, "give a quantile in [0, 1)")?;
        check(high > low && high <= 1.0, "disparity.high", &high, "give a quantile in (disparity.low, 1]")?;
        Ok(())
    }

    /// Depth `[height, width]` in `[near, far]` of an affine disparity map; 0 where `valid` is false or the value is not finite.
    ///
    /// # Errors
    /// [`Error::Config`] as in [`validate`](Self::validate); [`Error::Input`] when the shapes differ or no pixel is valid.
    pub fn depth(&self, disparity: ArrayView2<'_, f32>, valid: ArrayView2<'_, bool>) -> Result<Array2<f32>> {
        self.depth_between(disparity, valid, self.ends(disparity, valid)?)
    }

    /// The disparities of `far` and `near`: quantiles, or the extremes where these coincide.
    pub(crate) fn ends(&self, map: ArrayView2<'_, f32>, valid: ArrayView2<'_, bool>) -> Result<(f64, f64)> {
        self.validate()?;
        same_size(("the disparity", map.dim()), ("its mask", valid.dim()))?;
        let known = map.iter().zip(&valid).filter(|(d, v)| **v && d.is_finite());
        let mut values: Vec<f32> = known.map(|(d, _)| *d).collect();
        values.sort_unstable_by(f32::total_cmp);
        let ends = [self.low, self.high, 0.0, 1.0].map(|share| quantile_sorted(&values, share));
        let [Some(lo), Some(hi), Some(least), Some(most)] = ends else {
            let reason = "the disparity map has no valid pixel; check the file or the mask";
            return Err(Error::Input(reason.to_owned()));
        };
        Ok(if is_constant(lo, hi) { (least, most) } else { (lo, hi) })
    }

    /// As [`depth`](Self::depth), with the [`ends`](Self::ends) of another map of the same scale and shift, so that the depths of
    /// both agree.
    pub(crate) fn depth_between(
        &self,
        disparity: ArrayView2<'_, f32>,
        valid: ArrayView2<'_, bool>,
        (lo, hi): (f64, f64),
    ) -> Result<Array2<f32>> {
        same_size(("the disparity", disparity.dim()), ("its mask", valid.dim()))?;
        let a = 1.0 / self.near - 1.0 / self.far;
        let b = 1.0 / self.far;
        let constant = is_constant(lo, hi);
        Ok(Zip::from(&disparity).and(&valid).map_collect(|&d, &valid| {
            if !(valid && d.is_finite()) {
                return 0.0;
            }
            let unit = if constant { 0.5 } else { ((f64::from(d) - lo) / (hi - lo)).clamp(0.0, 1.0) };
            (1.0 / (a * unit + b)) as f32
        }))
    }
}

/// Whether two ends of a range differ by no more than rounding.
fn is_constant(lo: f64, hi: f64) -> bool {
    hi - lo <= CONSTANT * lo.abs().max(hi.abs())
}
