use crate::{FusionReport, Prior, Result};
use mde_uncertainty::GaussianDepth;

/// Brings a prior depth map and the evidence of rendered views together.
///
/// The loop uses nothing else of this crate; see `examples/own_fuser.rs` for another implementation.
pub trait Fuser {
    /// Fuses a prior `[height, width]` with views that were reprojected into its camera, all `[height, width]`
    /// z-depth in about the prior's unit. No evidence at all is allowed: the result is then the prior.
    ///
    /// # Errors
    /// Where a view's shape differs from the prior's, or the implementation cannot make sense of the input.
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> Result<Fused>;
}

/// What a fusion gives; every map is `[height, width]`, depth in the prior's unit, variance in that unit squared.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// Refined depth and its variance (Eq. 16-17); positive wherever it is known.
    pub depth: GaussianDepth,
    /// The views as one map (Eq. 7-8), in their own gauge.
    pub aggregated: GaussianDepth,
    /// The same in the prior's gauge (Eq. 10): \\(a\mu + b\\), \\(a^2\sigma^2\\).
    pub aligned: GaussianDepth,
    /// What was estimated on the way.
    pub report: FusionReport,
}
