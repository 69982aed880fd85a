use crate::{Aggregation, Result};
use mde_uncertainty::OutOfRange;

/// The choices of the fusion. The default is [`paper`](Self::paper).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct FusionConfig {
    /// Variance of the views: their own, or one constant for all.
    pub variance: VarianceRule,
    /// Lower bound of the views' standard deviation, as a fraction of their median depth (the paper's "clamp extremely small
    /// variances"). Larger values give confident pixels less weight.
    pub variance_floor: f64,
    /// Rule that turns the views of a pixel into one (Eq. 7-8).
    pub aggregation: Aggregation,
    /// Fit of the affine map from the views' depth to the prior's (Eq. 10-13).
    pub calibration: Calibration,
    /// Estimate of \\(\sigma_o^2\\) (Eq. 15). Not used for a prior that has a variance.
    pub prior_variance: PriorVariance,
    /// Standard deviation of the prior as a fraction of its median depth, for [`PriorVariance::FixedRelative`] and where the
    /// calibration is degenerate. Larger values give the views more weight.
    pub kappa: f64,
    /// Rule that combines the prior and the views (Eq. 16-17).
    pub fusion: Fusion,
    /// Standard deviation, as a fraction of the depth, of the error that the prior and the views share. Its square is added to
    /// the result's variance. Views warped by the prior share its error, and no residual shows it: this value is stated, not
    /// estimated. It is added once per fusion: use 0 where the result is the prior of another fusion. 0 is Eq. 17 as printed.
    pub common_error: f64,
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
            calibration: Calibration::Wls,
            prior_variance: PriorVariance::Moments,
            kappa: 0.1,
            fusion: Fusion::Bayes,
            common_error: 0.0,
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) names the field and what to do.
    pub fn validate(&self) -> Result<()> {
        let unit = 0.0..1.0;
        let fraction = "give a fraction from 0 to below 1";
        for (field, value) in
            [("fusion.variance-floor", self.variance_floor), ("fusion.common-error", self.common_error)]
        {
            OutOfRange::check(unit.contains(&value), field, &value, fraction)?;
        }
        let positive = self.kappa > 0.0 && self.kappa.is_finite();
        let remedy = "give a positive fraction, such as 0.1";
        Ok(OutOfRange::check(positive, "fusion.kappa", &self.kappa, remedy)?)
    }
}

/// Variance of the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum VarianceRule {
    /// Their own.
    #[default]
    Computed,
    /// One constant: the median of the variances of all views at all pixels that are not missing.
    ConstantMedian,
}

/// Fit of the affine map of Eq. 10.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Calibration {
    /// Weighted least squares, Eq. 11-13.
    #[default]
    Wls,
    /// None: \\(a = 1\\), \\(b = 0\\).
    None,
}

/// Estimate of the prior's variance \\(\sigma_o^2\\).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum PriorVariance {
    /// Moments, Eq. 15.
    #[default]
    Moments,
    /// The median over \\(\mathcal X\\) of \\(a^2 (\sigma_r^2)^{\mathrm{agg}}\\): weight 1/2 at the median pixel.
    FixedMedian,
    /// \\((\kappa \operatorname{median} D_o)^2\\).
    FixedRelative,
}

/// Rule that combines the prior and the calibrated views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Fusion {
    /// The posterior, Eq. 16-17.
    #[default]
    Bayes,
    /// The calibrated views where there are any, else the prior: the limit \\(\sigma_o^2 \to \infty\\).
    NerfOnly,
}
