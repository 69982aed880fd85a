use crate::{FusionReport, Prior, Result};
use mde_uncertainty::GaussianDepth;

/// Combines a prior depth map with the depth of rendered views.
///
/// `examples/own_fuser.rs` is another implementation.
pub trait Fuser {
    /// Fuses a prior `[height, width]` with views that were reprojected into its camera, all `[height, width]`
    /// z-depth in about the prior's unit. Without views the result is the prior.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) for a view of another size than the prior. An implementation returns an error of its
    /// own as [`Error::External`](crate::Error::External).
    fn fuse(&self, prior: &Prior, views: &[GaussianDepth]) -> Result<Fused>;
}

/// The result of a fusion. Every map is `[height, width]`, depth in the prior's unit, variance in that unit squared.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// Refined depth and its variance (Eq. 16-17); positive wherever it is not missing.
    pub depth: GaussianDepth,
    /// The aggregated views (Eq. 7-8), in their own scale and shift.
    pub aggregated: GaussianDepth,
    /// The same in the scale and shift of the prior (Eq. 10): \\(a\mu + b\\), \\(a^2\sigma^2\\).
    pub aligned: GaussianDepth,
    /// The estimated scalars and warnings.
    pub report: FusionReport,
}
