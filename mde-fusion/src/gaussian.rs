/// One scalar Gaussian: the depth of one pixel and its variance, in any unit and that unit squared.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gaussian {
    /// Mean.
    pub mean: f64,
    /// Variance, >= 0; 0 for an exact value.
    pub variance: f64,
}

impl Gaussian {
    /// A Gaussian with this mean and variance.
    #[inline]
    pub const fn new(mean: f64, variance: f64) -> Self {
        Self { mean, variance }
    }
}

/// A pair of values for an affine fit from \\(u\\) to \\(v\\). In Eq. 11, of a pixel of \\(\mathcal X\\), where neither the aggregate nor the
/// prior is missing; the fit holds for any other two maps, and for disparities.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// \\(u\\); in Eq. 11 \\(\mu_r^{\mathrm{agg}}\\).
    pub u: f64,
    /// Variance of \\(u\\), >= 0, whose inverse is the weight; in Eq. 11 \\((\sigma_r^2)^{\mathrm{agg}}\\).
    pub variance: f64,
    /// \\(v\\); in Eq. 11 \\(D_o\\).
    pub v: f64,
}

/// The nearest `f32`, always finite: a huge value must not become a missing one.
#[inline]
pub(crate) fn to_f32(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// The least of the variances; infinite without any.
pub(crate) fn least_variance(variances: impl Iterator<Item = f64>) -> f64 {
    variances.fold(f64::INFINITY, f64::min)
}

/// A precision relative to that of the least variance: in 0 to 1 where a plain reciprocal could overflow. Where the
/// least variance is 0, only estimates as exact as it count.
#[inline]
pub(crate) fn relative_precision(least: f64, variance: f64) -> f64 {
    if variance <= least { 1.0 } else { least / variance }
}
