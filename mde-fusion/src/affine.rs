use crate::gaussian::{least_variance, relative_precision};
use crate::{Gaussian, Result, Sample};

/// The map from the views' depth to the prior's: \\(\tilde D_r = a\\,\mu_r^{\mathrm{agg}} + b\\) (Eq. 10).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// Scale \\(a\\).
    pub a: f64,
    /// Shift \\(b\\), in the prior's unit.
    pub b: f64,
}

impl Affine {
    /// \\(a = 1\\), \\(b = 0\\).
    pub const IDENTITY: Self = Self { a: 1.0, b: 0.0 };

    /// Eq. 10 for a Gaussian: mean \\(a\mu + b\\), variance \\(a^2\sigma^2\\).
    #[inline]
    pub fn apply(self, estimate: Gaussian) -> Gaussian {
        Gaussian::new(self.a * estimate.mean + self.b, self.a * self.a * estimate.variance)
    }
}

/// An affine fit and how well it is determined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AffineFit {
    /// The fitted map.
    pub affine: Affine,
    /// Effective number of pixels \\((\sum p)^2 / \sum p^2\\) of the fit: 1 where one pixel has all the weight,
    /// the number of pixels where all weigh the same.
    pub effective_support: f64,
    /// Weighted correlation of \\(u\\) and \\(v\\); 0 where either is constant.
    pub correlation: f64,
    /// \\(\sum p (u-\bar u)^2 / \sum p u^2\\): 0 where \\(u\\) is constant and the slope unknown.
    pub relative_spread: f64,
}

/// Weighted least squares line from \\(u\\) to \\(v\\), in the fusion from the views' depth to the prior's (Eq. 11-13).
///
/// \\[ (a^\star, b^\star) = \arg\min_{a,b} \sum_{x\in\mathcal X}
/// \frac{\bigl(a\\,u(x) + b - v(x)\bigr)^2}{(\sigma_r^2)^{\mathrm{agg}}(x)} \\]
///
/// with \\(u = \mu_r^{\mathrm{agg}}\\), \\(v = D_o\\), \\(p = 1/(\sigma_r^2)^{\mathrm{agg}}\\). Eq. 13,
///
/// \\[ a^\star = \frac{S_p S_{puv} - S_{pu} S_{pv}}{S_p S_{puu} - S_{pu}^2},\qquad
/// b^\star = \frac{S_{pv} - a^\star S_{pu}}{S_p}, \\]
///
/// is evaluated in its centred form, the same number without the cancellation:
///
/// \\[ a^\star = \frac{\sum p (u-\bar u)(v-\bar v)}{\sum p (u-\bar u)^2},\qquad b^\star = \bar v - a^\star \bar u. \\]
///
/// Only the ratios of the weights matter, so they are taken relative to the largest. Samples of variance 0 are exact: where
/// there are any, they alone count, which is the limit. `None` where the line is not determined: fewer than two samples, or all
/// weight on one value of \\(u\\).
pub fn affine_wls(samples: &[Sample]) -> Option<AffineFit> {
    let line = Line::new(samples)?;
    let a = line.suv / line.suu;
    let b = line.mean_v - a * line.mean_u;
    (a.is_finite() && b.is_finite()).then(|| line.describe(Affine { a, b }))
}

/// Centred weighted sums of pairs \\((u, v)\\).
pub(crate) struct Line {
    sum_p: f64,
    sum_pp: f64,
    mean_u: f64,
    mean_v: f64,
    suu: f64,
    suv: f64,
    svv: f64,
}

impl Line {
    /// Sums with weights relative to the largest; `None` without positive weight.
    pub(crate) fn new(samples: &[Sample]) -> Option<Self> {
        let least = least_variance(samples.iter().map(|s| s.variance));
        let points = samples.iter().map(|s| (relative_precision(least, s.variance), s.u, s.v));
        // About the first point, so that the sums of a constant are exactly constant.
        let (_, u0, v0) = points.clone().find(|(p, ..)| *p > 0.0)?;
        let (mut sum_p, mut sum_pp, mut mean_u, mut mean_v) = (0.0, 0.0, 0.0, 0.0);
        for (p, u, v) in points.clone() {
            sum_p += p;
            sum_pp += p * p;
            mean_u += p * (u - u0);
            mean_v += p * (v - v0);
        }
        let (mean_u, mean_v) = (u0 + mean_u / sum_p, v0 + mean_v / sum_p);
        let (mut suu, mut suv, mut svv) = (0.0, 0.0, 0.0);
        for (p, u, v) in points {
            let (du, dv) = (u - mean_u, v - mean_v);
            suu += p * du * du;
            suv += p * du * dv;
            svv += p * dv * dv;
        }
        Some(Self { sum_p, sum_pp, mean_u, mean_v, suu, suv, svv })
    }

    /// The diagnostics of a map of these pairs.
    pub(crate) fn describe(&self, affine: Affine) -> AffineFit {
        let correlation = self.suv / (self.suu.sqrt() * self.svv.sqrt());
        let total = self.suu + self.sum_p * self.mean_u * self.mean_u;
        AffineFit {
            affine,
            effective_support: self.sum_p * self.sum_p / self.sum_pp,
            correlation: if correlation.is_finite() { correlation.clamp(-1.0, 1.0) } else { 0.0 },
            relative_spread: if total > 0.0 { self.suu / total } else { 0.0 },
        }
    }
}

/// Relative spread at the resolution of an `f32`: the depth is constant to within its precision.
const CONSTANT: f64 = f32::EPSILON as f64 * f32::EPSILON as f64;

/// The map of the fit to `samples`, or why it is refused as a calibration. A fit of `None` is not determined.
pub(crate) fn accepted(samples: &[Sample], fit: Option<AffineFit>) -> Result<Affine, Degenerate> {
    match (samples.len(), fit) {
        (found @ ..2, _) => Err(Degenerate::Support { found }),
        (_, Some(AffineFit { affine, relative_spread, .. })) if relative_spread > CONSTANT => {
            let Affine { a, .. } = affine;
            if a > 0.0 && a.is_finite() { Ok(affine) } else { Err(Degenerate::Scale { a }) }
        }
        (_, fit) => Err(Degenerate::Singular { relative_spread: fit.map_or(0.0, |fit| fit.relative_spread) }),
    }
}

/// Why a calibration was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "reason", rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum Degenerate {
    /// Too few pixels where both the prior and a view have a depth.
    #[error("only {found} pixels have both a prior depth and a view; 2 are needed")]
    Support {
        /// Number of pixels.
        found: usize,
    },
    /// The views' depth is constant to within its precision.
    #[error(
        "the views' depth is constant (relative spread {relative_spread:e}), so the scale is undetermined"
    )]
    Singular {
        /// \\(\sum p(u-\bar u)^2 / \sum p u^2\\).
        relative_spread: f64,
    },
    /// A scale that is not positive.
    #[error("the scale {a} from the views to the prior is not positive")]
    Scale {
        /// The fitted scale.
        a: f64,
    },
}
