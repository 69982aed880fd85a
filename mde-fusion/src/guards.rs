use crate::{AffineFit, Error, Result};

/// What makes a calibration degenerate, so that it must not be used.
///
/// The default, the paper's, holds only what is degenerate mathematically: fewer than two pixels, a singular fit, a
/// scale that is not positive. [`Guards::strict`] also refuses what is merely implausible.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct Guards {
    /// Least number of pixels \\(|\mathcal X|\\).
    pub min_support: usize,
    /// Least number of pixels as a fraction of the map.
    pub min_support_fraction: f64,
    /// Least effective number of pixels behind the fit.
    pub min_effective_support: f64,
    /// The fit is singular where \\(\sum p(u-\bar u)^2\\) is at most this fraction of \\(\sum p u^2\\).
    pub singular: f64,
    /// The scale \\(a\\) must be greater.
    pub min_scale: f64,
    /// The scale \\(a\\) must be less; no bound where absent.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub max_scale: Option<f64>,
    /// Least weighted correlation between the NeRF's depth and the prior's.
    pub min_correlation: f64,
}

/// Relative spread at the resolution of an `f32`: the depth is constant as far as the map can tell.
const F32_SPREAD: f64 = f32::EPSILON as f64 * f32::EPSILON as f64;

impl Default for Guards {
    fn default() -> Self {
        Self {
            min_support: 2,
            min_support_fraction: 0.0,
            min_effective_support: 0.0,
            singular: F32_SPREAD,
            min_scale: 0.0,
            max_scale: None,
            min_correlation: -1.0,
        }
    }
}

impl Guards {
    /// Guards against an implausible calibration: fewer than 100 pixels or 1 % of the map, fewer than 50 effective
    /// ones, a relative spread of 1e-9, a scale outside 0.2 to 5, a correlation below 0.2.
    pub fn strict() -> Self {
        Self {
            min_support: 100,
            min_support_fraction: 0.01,
            min_effective_support: 50.0,
            singular: 1e-9,
            min_scale: 0.2,
            max_scale: Some(5.0),
            min_correlation: 0.2,
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] with the field at fault.
    pub fn validate(&self) -> Result<()> {
        let within = |field, value: f64, ok: bool, remedy| match ok {
            true => Ok(()),
            false => Err(Error::Config { field, value, remedy }),
        };
        let (fraction, effective) = (self.min_support_fraction, self.min_effective_support);
        let unit = 0.0..=1.0;
        within("guards.min-support-fraction", fraction, unit.contains(&fraction), "take 0 to 1")?;
        within("guards.min-effective-support", effective, effective >= 0.0, "take a number >= 0")?;
        within("guards.singular", self.singular, unit.contains(&self.singular), "take 0 to 1")?;
        within("guards.min-scale", self.min_scale, self.min_scale >= 0.0, "take a number >= 0")?;
        if let Some(max) = self.max_scale {
            within(
                "guards.max-scale",
                max,
                max > self.min_scale,
                "take more than min-scale, or leave it out",
            )?;
        }
        let correlation = self.min_correlation;
        within("guards.min-correlation", correlation, correlation.abs() <= 1.0, "take -1 to 1")
    }

    /// Whether `support` pixels of a map of `pixels` are too few.
    pub fn check_support(&self, support: usize, pixels: usize) -> Option<Degenerate> {
        let share = (self.min_support_fraction * pixels as f64).ceil() as usize;
        // Without a single pixel no guard can be loose enough.
        let needed = self.min_support.max(share).max(1);
        (support < needed).then_some(Degenerate::Support { found: support, needed })
    }

    /// What is wrong with a fit; `None` for the fit means that it could not be determined at all.
    pub fn check_fit(&self, fit: Option<&AffineFit>) -> Option<Degenerate> {
        let Some(fit) = fit else { return Some(Degenerate::Singular { relative_spread: 0.0 }) };
        let a = fit.affine.a;
        if fit.relative_spread <= self.singular {
            Some(Degenerate::Singular { relative_spread: fit.relative_spread })
        } else if !(a > self.min_scale && self.max_scale.is_none_or(|max| a < max)) {
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
    /// Too few pixels that both the prior and the views know.
    #[error("only {found} pixels are known to both the prior and the views; {needed} are needed")]
    Support {
        /// Number of pixels found.
        found: usize,
        /// Number of pixels needed.
        needed: usize,
    },
    /// The NeRF's depth is constant as far as its weights see.
    #[error(
        "the views' depth is constant (relative spread {relative_spread:e}), so the scale is undetermined"
    )]
    Singular {
        /// \\(\sum p(u-\bar u)^2 / \sum p u^2\\).
        relative_spread: f64,
    },
    /// A scale that is not positive, or out of the guards' range.
    #[error("the scale {a} from the views to the prior is out of range")]
    Scale {
        /// The fitted scale.
        a: f64,
    },
    /// A few pixels have all the weight.
    #[error("the fit rests on {found:.1} effective pixels")]
    EffectiveSupport {
        /// Effective number of pixels.
        found: f64,
    },
    /// The views' depth has little to do with the prior's.
    #[error("the views' depth and the prior's correlate by {found:.3} only")]
    Correlation {
        /// Weighted correlation.
        found: f64,
    },
}
