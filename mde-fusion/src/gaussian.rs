/// One scalar Gaussian: the belief about one pixel.
///
/// The mean is in the unit of the space that the caller works in (depth or disparity), the variance in that unit
/// squared.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gaussian {
    /// Mean.
    pub mean: f64,
    /// Variance, >= 0.
    pub variance: f64,
}

impl Gaussian {
    /// A belief with this mean and variance.
    #[inline]
    pub const fn new(mean: f64, variance: f64) -> Self {
        Self { mean, variance }
    }

    /// \\(1/\sigma^2\\); infinite where the variance is 0.
    #[inline]
    pub fn precision(self) -> f64 {
        self.variance.recip()
    }
}

/// What the affine fit sees of one pixel of \\(\mathcal X\\), where both the prior and the aggregate know something.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// \\(u = \mu_r^{\mathrm{agg}}\\).
    pub nerf: f64,
    /// \\((\sigma_r^2)^{\mathrm{agg}}\\), >= 0.
    pub variance: f64,
    /// \\(v = D_o\\).
    pub prior: f64,
}

/// The nearest `f32`, finite whatever comes: a huge value must not turn into "missing".
#[inline]
pub(crate) fn to_f32(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// A precision relative to that of the least variance: in 0 to 1 where a plain reciprocal could overflow. Where the
/// least variance is 0, only estimates as exact as it count.
#[inline]
pub(crate) fn relative_precision(least: f64, variance: f64) -> f64 {
    if variance <= least { 1.0 } else { least / variance }
}
