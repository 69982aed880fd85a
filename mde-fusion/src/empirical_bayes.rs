use crate::Residual;

/// Moment estimate of the prior's variance before clamping: the inside of Eq. 15.
///
/// \\[ \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \left(\delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\right) \\]
///
/// Unbiased under Eq. 14, hence negative now and then. 0 without residuals.
pub fn prior_variance_moments(residuals: &[Residual]) -> f64 {
    let sum: f64 = residuals.iter().map(|r| r.delta * r.delta - r.variance).sum();
    sum / residuals.len().max(1) as f64
}

/// Empirical-Bayes variance of the prior (Eq. 15).
///
/// \\[ \sigma_o^2 = \max\left(0,\\; \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \left(\delta(x)^2 - a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\right)\right) \\]
///
/// Unweighted, so that a few diffuse rays whose stated variance is too large drive it to 0, and the NeRF is then
/// ignored everywhere; [`paule_mandel`](crate::paule_mandel) and
/// [`maximum_likelihood`](crate::maximum_likelihood) weigh the pixels.
pub fn empirical_bayes(residuals: &[Residual]) -> f64 {
    prior_variance_moments(residuals).max(0.0)
}
