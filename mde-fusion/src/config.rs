use crate::{Aggregation, Error, Guards, Result, VarianceRule};

/// The choices of the fusion. The default is [`paper`](Self::paper).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct FusionConfig {
    /// Variance of the views: their own, or one constant for all.
    pub variance: VarianceRule,
    /// Lower bound of the views' standard deviation, as a fraction of their median depth (the paper's "clamp extremely small
    /// variances"). Larger values give confident pixels less weight.
    pub variance_floor: f64,
    /// Rule that turns the views of a pixel into one (Eq. 7-8).
    pub aggregation: Aggregation,
    /// Whether the aggregated variance is that of the mixture of the views, in place of Eq. 8, which assumes independent views.
    pub spread: bool,
    /// Fit of the affine map from the views' depth to the prior's (Eq. 10-13).
    pub calibration: Calibration,
    /// Estimate of \\(\sigma_o^2\\) (Eq. 15). Not used for a prior that has a variance.
    pub prior_variance: PriorVariance,
    /// Standard deviation of the prior as a fraction of its median depth, for [`PriorVariance::FixedRelative`] and where the
    /// calibration is degenerate. Larger values give the views more weight.
    pub kappa: f64,
    /// Rule that combines the prior and the views (Eq. 16-17).
    pub fusion: Fusion,
    /// Lower bound of the result's standard deviation, as a fraction of the prior's median depth. 0 is Eq. 17 as printed, which
    /// gives 0 wherever Eq. 15 does.
    pub posterior_floor: f64,
    /// Standard deviation, as a fraction of the depth, of the error that the prior and the views share. Its square is added to
    /// the result's variance. Views warped by the prior share its error, and no residual shows it: this value is stated, not
    /// estimated. It is added once per fusion: use 0 where the result is the prior of another fusion. 0 is Eq. 17 as printed.
    pub common_error: f64,
    /// When a calibration is refused as degenerate.
    pub guards: Guards,
}

impl Default for FusionConfig {
    fn default() -> Self {
        Self::paper()
    }
}

impl FusionConfig {
    /// Eq. 7-17 as printed, with a variance floor of 0.1 % of the median depth, which the paper leaves open.
    pub fn paper() -> Self {
        Self {
            variance: VarianceRule::Computed,
            variance_floor: 1e-3,
            aggregation: Aggregation::Precision,
            spread: false,
            calibration: Calibration::Wls,
            prior_variance: PriorVariance::Moments,
            kappa: 0.1,
            fusion: Fusion::Bayes,
            posterior_floor: 0.0,
            common_error: 0.0,
            guards: Guards::Paper,
        }
    }

    /// Mixture variance, effective-variance calibration, a heteroscedastic prior variance, strict guards, and a lower bound of
    /// 0.1 % of the median depth for the result's standard deviation.
    pub fn robust() -> Self {
        Self {
            spread: true,
            calibration: Calibration::Effective,
            prior_variance: PriorVariance::Heteroscedastic,
            posterior_floor: 1e-3,
            guards: Guards::Strict,
            ..Self::paper()
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] names the field and what to do.
    pub fn validate(&self) -> Result<()> {
        let check = |field, value: f64, valid: bool, remedy| match valid {
            true => Ok(()),
            false => Err(Error::Config { field, value: value.to_string(), remedy }),
        };
        let unit = 0.0..1.0;
        let fraction = "give a fraction from 0 to below 1";
        for (field, value) in [
            ("fusion.variance-floor", self.variance_floor),
            ("fusion.posterior-floor", self.posterior_floor),
            ("fusion.common-error", self.common_error),
        ] {
            check(field, value, unit.contains(&value), fraction)?;
        }
        let kappa = self.kappa;
        check(
            "fusion.kappa",
            kappa,
            kappa > 0.0 && kappa.is_finite(),
            "give a positive fraction, such as 0.1",
        )
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
pub(crate) use choice;

choice! {
    /// Fit of the affine map of Eq. 10.
    Calibration {
        /// Weighted least squares, Eq. 11-13.
        #[default]
        Wls,
        /// None: \\(a = 1\\), \\(b = 0\\).
        None,
        /// Least squares without weights: Eq. 13 with \\(p = 1\\).
        Ols,
        /// Iterated weighted least squares with effective variances, a ridge and Huber's weights. With
        /// \\(t = \sigma_o^2 + a^2 (\sigma_r^2)^{\mathrm{agg}}\\), the variance of a residual by Eq. 14,
        ///
        /// \\[ \min_{a,b} \sum_{x\in\mathcal X} \frac{h(x)}{t(x)} \bigl(a u(x) + b - v(x)\bigr)^2 +
        /// \frac{(a-1)^2}{\sigma_a^2} + \frac{b^2}{\sigma_b^2},\qquad
        /// h = \min\left(1, \frac{k \sqrt t}{|\delta|}\right), \\]
        ///
        /// with \\(k = 1.345\\), \\(\sigma_a = 0.05\\) and \\(\sigma_b\\) 5 % of the median prior depth. \\(t\\) and \\(h\\) are those of
        /// the previous map, and \\(\sigma_o^2\\) is Huber's proposal 2, in at most ten rounds from the identity. Eq. 11 weighs by the
        /// views' variance alone, so that a few pixels of tiny variance determine the map. Noise in \\(u\\) attenuates the scale
        /// here too; only the ridge counteracts it.
        Effective,
    }
}

choice! {
    /// Estimate of the prior's variance \\(\sigma_o^2\\).
    PriorVariance {
        /// Moments, Eq. 15.
        #[default]
        Moments,
        /// The median over \\(\mathcal X\\) of \\(a^2 (\sigma_r^2)^{\mathrm{agg}}\\): weight 1/2 at the median pixel.
        FixedMedian,
        /// \\((\kappa \operatorname{median} D_o)^2\\).
        FixedRelative,
        /// A variance per pixel, \\(\sigma_o^2(x) = c_0 + c_1 |\nabla D_o(x)|^2 + c_2 D_o(x)^4\\) with \\(c \ge 0\\): a constant, an error of
        /// localisation, and a constant error of disparity. \\(c\\) is the non-negative least-squares fit of the summand of Eq. 15.
        Heteroscedastic,
    }
}

choice! {
    /// Rule that combines the prior and the calibrated views.
    Fusion {
        /// The posterior, Eq. 16-17.
        #[default]
        Bayes,
        /// The calibrated views where there are any, else the prior: the limit \\(\sigma_o^2 \to \infty\\).
        NerfOnly,
    }
}
