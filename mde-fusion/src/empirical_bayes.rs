use crate::Residual;

/// Empirical-Bayes variance of the prior (Eq. 15): the moment estimate, which is unbiased under Eq. 14 and hence sometimes negative,
/// clamped at 0.
///
/// \\[ \sigma_o^2 = \max\left(0,\\; \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \left(\delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\right)\right) \\]
///
/// The mean is not weighted: a few diffuse rays whose stated variance is too large make it 0, and the views are then
/// ignored everywhere. 0 without residuals.
pub fn empirical_bayes(residuals: &[Residual]) -> f64 {
    let sum: f64 = residuals.iter().map(|r| r.delta * r.delta - r.variance).sum();
    (sum / residuals.len().max(1) as f64).max(0.0)
}
