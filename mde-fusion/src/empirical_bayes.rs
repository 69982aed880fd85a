use crate::Residual;

/// Moment estimate of the prior's variance before clamping: the inside of Eq. 15.
///
/// \\[ \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \left(\delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\right) \\]
///
/// Unbiased under Eq. 14, hence sometimes negative. 0 without residuals.
pub(crate) fn prior_variance_moments(residuals: &[Residual]) -> f64 {
    let sum: f64 = residuals.iter().map(|r| r.delta * r.delta - r.variance).sum();
    sum / residuals.len().max(1) as f64
}

/// Empirical-Bayes variance of the prior (Eq. 15).
///
/// \\[ \sigma_o^2 = \max\left(0,\\; \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \left(\delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\right)\right) \\]
///
/// The mean is not weighted: a few diffuse rays whose stated variance is too large make it 0, and the views are then
/// ignored everywhere.
pub fn empirical_bayes(residuals: &[Residual]) -> f64 {
    prior_variance_moments(residuals).max(0.0)
}
