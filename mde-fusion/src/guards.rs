use crate::AffineFit;
use crate::config::choice;

choice! {
    /// When a calibration is refused as degenerate, so that the result is the prior.
    Guards {
        /// Where it is not determined: fewer than two pixels, a singular fit, or a scale that is not positive.
        #[default]
        Paper,
        /// Where it is implausible too: fewer than 100 pixels or 1 % of the map, fewer than 50 effective pixels, a relative
        /// spread of the depth below 1e-9, a scale outside of 0.2 to 5, or a correlation below 0.2.
        Strict,
    }
}

/// The bounds behind [`Guards`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    /// Least number of pixels \\(|\mathcal X|\\).
    pub(crate) min_support: usize,
    /// Least number of pixels as a fraction of the map.
    pub(crate) min_support_fraction: f64,
    /// Least effective number of pixels of the fit.
    pub(crate) min_effective_support: f64,
    /// The fit is singular where \\(\sum p(u-\bar u)^2\\) is at most this fraction of \\(\sum p u^2\\).
    pub(crate) singular: f64,
    /// The scale \\(a\\) must be greater.
    pub(crate) min_scale: f64,
    /// The scale \\(a\\) must be less.
    pub(crate) max_scale: f64,
    /// Least weighted correlation of the views' depth with the prior's.
    pub(crate) min_correlation: f64,
}

/// Relative spread at the resolution of an `f32`: the depth is constant to within its precision.
const F32_SPREAD: f64 = f32::EPSILON as f64 * f32::EPSILON as f64;

impl Guards {
    pub(crate) fn bounds(self) -> Bounds {
        match self {
            Self::Paper => Bounds {
                min_support: 2,
                min_support_fraction: 0.0,
                min_effective_support: 0.0,
                singular: F32_SPREAD,
                min_scale: 0.0,
                max_scale: f64::INFINITY,
                min_correlation: -1.0,
            },
            Self::Strict => Bounds {
                min_support: 100,
                min_support_fraction: 0.01,
                min_effective_support: 50.0,
                singular: 1e-9,
                min_scale: 0.2,
                max_scale: 5.0,
                min_correlation: 0.2,
            },
        }
    }
}

impl Bounds {
    /// Whether `support` pixels of a map of `pixels` are too few.
    pub(crate) fn check_support(&self, support: usize, pixels: usize) -> Option<Degenerate> {
        let share = (self.min_support_fraction * pixels as f64).ceil() as usize;
        let needed = self.min_support.max(share);
        (support < needed).then_some(Degenerate::Support { found: support, needed })
    }

    /// What is wrong with a fit; `None` for the fit means that it is not determined.
    pub(crate) fn check_fit(&self, fit: Option<&AffineFit>) -> Option<Degenerate> {
        let Some(fit) = fit else { return Some(Degenerate::Singular { relative_spread: 0.0 }) };
        let a = fit.affine.a;
        if fit.relative_spread <= self.singular {
            Some(Degenerate::Singular { relative_spread: fit.relative_spread })
        } else if !(a > self.min_scale && a < self.max_scale) {
            Some(Degenerate::Scale { a })
        } else if fit.effective_support < self.min_effective_support {
            Some(Degenerate::EffectiveSupport { found: fit.effective_support })
        } else if fit.correlation < self.min_correlation {
            Some(Degenerate::Correlation { found: fit.correlation })
        } else {
            None
        }
    }
}

/// Why a calibration was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "reason", rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum Degenerate {
    /// Too few pixels where both the prior and a view have a depth.
    #[error("only {found} pixels have both a prior depth and a view; {needed} are needed")]
    Support {
        /// Number of pixels found.
        found: usize,
        /// Number of pixels needed.
        needed: usize,
    },
    /// The views' depth is constant to within its precision.
    #[error(
        "the views' depth is constant (relative spread {relative_spread:e}), so the scale is undetermined"
    )]
    Singular {
        /// \\(\sum p(u-\bar u)^2 / \sum p u^2\\).
        relative_spread: f64,
    },
    /// A scale that is not positive, or outside of the range of the guards.
    #[error("the scale {a} from the views to the prior is out of range")]
    Scale {
        /// The fitted scale.
        a: f64,
    },
    /// A few pixels have nearly all the weight.
    #[error("the fit has {found:.1} effective pixels only")]
    EffectiveSupport {
        /// Effective number of pixels.
        found: f64,
    },
    /// The views' depth hardly correlates with the prior's.
    #[error("the correlation of the views' depth with the prior's is {found:.3} only")]
    Correlation {
        /// Weighted correlation.
        found: f64,
    },
}
