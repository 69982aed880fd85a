use crate::{Affine, Sample};

/// The residual of Eq. 14 at one pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residual {
    /// \\(\delta = D_o - \tilde D_r\\).
    pub delta: f64,
    /// \\(a^2 (\sigma_r^2)^{\mathrm{agg}}\\), the views' share of the variance of \\(\delta\\).
    pub variance: f64,
}

/// Residuals of the prior against the calibrated views (Eq. 14).
///
/// \\[ \delta(x) = D_o(x) - \tilde D_r(x),\qquad
/// \delta(x) \sim \mathcal N\\!\bigl(0,\\; \sigma_o^2 + a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\bigr) \\]
pub fn residuals(samples: &[Sample], affine: Affine) -> Vec<Residual> {
    let Affine { a, b } = affine;
    let residual = |s: &Sample| Residual { delta: s.v - (a * s.u + b), variance: a * a * s.variance };
    samples.iter().map(residual).collect()
}

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
