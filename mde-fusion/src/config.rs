use crate::{Aggregation, EffectiveConfig, Error, Guards, Result, VarianceRule};

/// Every choice in the fusion. The default is the [`paper`](Self::paper)'s.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct FusionConfig {
    /// Where the Gaussians live.
    pub space: Space,
    /// Which variance the views come with.
    pub variance: VarianceRule,
    /// Least standard deviation of a view, as a fraction of the views' median depth
    /// ([`variance_floor`](crate::variance_floor)): the paper's "clamp extremely small variances".
    pub variance_floor: f64,
    /// How the views become one (Eq. 7-8).
    pub aggregation: Aggregation,
    /// Take the views' [mixture variance](crate::mixture_variance) in place of Eq. 8.
    pub spread: bool,
    /// How the views' depth is brought to the prior's (Eq. 10-13).
    pub calibration: Calibration,
    /// Output where the calibration is [degenerate](Guards).
    pub on_degenerate: OnDegenerate,
    /// How \\(\sigma_o^2\\) is found (Eq. 15). A prior that has a variance keeps it.
    pub prior_variance: PriorVariance,
    /// Relative standard deviation of the prior for [`PriorVariance::FixedRelative`], and wherever no estimate exists
    /// (a degenerate calibration).
    pub kappa: f64,
    /// How prior and views become the result (Eq. 16-17).
    pub fusion: Fusion,
    /// What a pixel gets that the views know but the prior does not.
    pub missing_prior: MissingPrior,
    /// Least standard deviation of the result, as a fraction of the prior's median depth; 0 leaves Eq. 17 as printed,
    /// which is 0 everywhere where Eq. 15 is.
    pub posterior_floor: f64,
    /// Standard deviation, as a fraction of each pixel's depth, of the error that the prior and the views have in common;
    /// its square is added to the result's variance. Views warped by the prior share its error, and no residual between
    /// the two can show it, so this is a statement of the caller, not an estimate. It is added once a fusion: leave it 0
    /// where the result becomes the next fusion's prior. 0 leaves Eq. 17 as printed.
    pub common_error: f64,
    /// In [`Space::Disparity`], no calibrated depth is farther than this multiple of the prior's farthest.
    pub far: f64,
    /// When a calibration is degenerate.
    pub guards: Guards,
    /// Settings of [`Calibration::Effective`].
    pub effective: EffectiveConfig,
}

impl Default for FusionConfig {
    fn default() -> Self {
        Self::paper()
    }
}

impl FusionConfig {
    /// Eq. 7-17 as printed. Where the paper leaves a value open: a variance floor of 0.1 % of the median depth, only
    /// mathematically degenerate calibrations refused, a missing prior pixel stays missing.
    pub fn paper() -> Self {
        Self {
            space: Space::Depth,
            variance: VarianceRule::Computed,
            variance_floor: 1e-3,
            aggregation: Aggregation::Precision,
            spread: false,
            calibration: Calibration::Wls,
            on_degenerate: OnDegenerate::Monocular,
            prior_variance: PriorVariance::Moments,
            kappa: 0.1,
            fusion: Fusion::Bayes,
            missing_prior: MissingPrior::Missing,
            posterior_floor: 0.0,
            common_error: 0.0,
            far: 1.25,
            guards: Guards::default(),
            effective: EffectiveConfig::default(),
        }
    }

    /// The remedies together: mixture variance, effective-variance calibration, a heteroscedastic prior variance,
    /// strict guards, and a result that never claims to be exact.
    pub fn robust() -> Self {
        Self {
            spread: true,
            calibration: Calibration::Effective,
            prior_variance: PriorVariance::Heteroscedastic,
            posterior_floor: 1e-3,
            guards: Guards::strict(),
            ..Self::paper()
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] with the field at fault and what to write instead.
    pub fn validate(&self) -> Result<()> {
        let check = |field, value: f64, ok: bool, remedy| match ok && value.is_finite() {
            true => Ok(()),
            false => Err(Error::Config { field, value, remedy }),
        };
        let (floor, posterior, kappa) = (self.variance_floor, self.posterior_floor, self.kappa);
        let unit = 0.0..1.0;
        check(
            "variance-floor",
            floor,
            unit.contains(&floor),
            "take a fraction from 0 to below 1, such as 1e-3",
        )?;
        check(
            "common-error",
            self.common_error,
            unit.contains(&self.common_error),
            "take a fraction from 0 to below 1",
        )?;
        check("posterior-floor", posterior, unit.contains(&posterior), "take a fraction from 0 to below 1")?;
        check("kappa", kappa, kappa > 0.0, "take a positive relative deviation, such as 0.1")?;
        check("far", self.far, self.far >= 1.0, "take a multiple of at least 1, such as 1.25")?;
        self.guards.validate()?;
        self.effective.validate()
    }
}

macro_rules! choice {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
        pub enum $name { $($(#[$variant_doc])* $variant),+ }
    };
}

choice! {
    /// The space that Eq. 7-17 are evaluated in.
    Space {
        /// Depth: the paper's.
        #[default]
        Depth,
        /// Disparity \\(1/D\\): an affine map of it is exactly what a relative prior leaves open, and its noise is
        /// more nearly the same everywhere. Moments are carried there and back with the [mean](crate::to_disparity)
        /// [correction](crate::to_depth).
        Disparity,
    }
}

choice! {
    /// How the affine map of Eq. 10 is found.
    Calibration {
        /// Weighted least squares, Eq. 11-13.
        #[default]
        Wls,
        /// None: \\(a = 1\\), \\(b = 0\\).
        None,
        /// Least squares without weights.
        Ols,
        /// [Iterated, with effective variances, a ridge and Huber weights](crate::affine_effective).
        Effective,
    }
}

choice! {
    /// The result where the calibration is degenerate.
    OnDegenerate {
        /// The prior as it is: the paper's "reverting to the monocular estimate".
        #[default]
        Monocular,
        /// Fusion without calibration, \\(a = 1\\), \\(b = 0\\).
        Identity,
    }
}

choice! {
    /// How the prior's variance \\(\sigma_o^2\\) is found.
    PriorVariance {
        /// Moments, Eq. 15.
        #[default]
        Moments,
        /// The median over \\(\mathcal X\\) of \\(a^2 (\sigma_r^2)^{\mathrm{agg}}\\): weight 1/2 at the median pixel.
        FixedMedian,
        /// \\((\kappa \operatorname{median} D_o)^2\\).
        FixedRelative,
        /// [Paule-Mandel](crate::paule_mandel).
        PauleMandel,
        /// [Maximum likelihood](crate::maximum_likelihood).
        MaximumLikelihood,
        /// [A variance by pixel](crate::Heteroscedastic).
        Heteroscedastic,
    }
}

choice! {
    /// How prior and calibrated views become the result.
    Fusion {
        /// The posterior, Eq. 16-17.
        #[default]
        Bayes,
        /// The calibrated views where there are any, else the prior: the limit \\(\sigma_o^2 \to \infty\\).
        NerfOnly,
    }
}

choice! {
    /// What a pixel gets that only the views know ([`Fusion::NerfOnly`] always gives it theirs).
    MissingPrior {
        /// Nothing: it stays missing, and the result has the prior's support.
        #[default]
        Missing,
        /// The calibrated views' depth and variance.
        Nerf,
    }
}
