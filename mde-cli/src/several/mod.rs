//! Several photographs of one static scene, in the order in which they pass through the loop:
//!
//! | Stage | What | Where |
//! |---|---|---|
//! | prior | one prediction per photograph | [`DepthPrior`](mde_prior::DepthPrior) |
//! | poses | refined where given, estimated from matches and the prior where not | [`mde_mvs::poses`] |
//! | sweep | plane sweeps of every photograph and their consensus, exposures | [`mde_mvs::consensus`], [`mde_mvs::exposure`] |
//! | fit | a field on all photographs and their consensus depths | [`RadianceField::fit`](mde_nerf::RadianceField::fit) |
//! | render | depth and variance of the reference (Eq. 2-5) | [`RadianceField::render`](mde_nerf::RadianceField::render) |
//! | fuse | unit, fallback and standard deviation | [`mod@self`] |
//!
//! The poses fix the gauge, so the prior is brought to the field and not the field to the prior (`docs/method.md`).

mod cameras;
mod novel;
pub mod prepared;
mod priors;
mod result;
mod withheld;

use crate::config::Config;
use crate::error::Result;
use crate::refinement::event::Callback;
use crate::refinement::stages::Stages;
use crate::reports::Refinement;
use crate::scene::Scene;
use crate::several::prepared::PreparedScene;

/// Refines the depth of the reference photograph with the parallax of the others; [`PreparedScene`] refines several of them.
///
/// Depth and sigma are `[height, width]` of the reference, z in the prior's unit. Where the photographs carry no depth (no
/// common scene, no parallax, hardly anything verified, or a withheld photograph that the prior explains better), the result is that
/// of [`refine`](crate::refine) without a field for the reference alone, and
/// [`CaptureReport::fallback`](crate::reports::capture::CaptureReport::fallback) has the reason.
///
/// # Errors
/// The error of a stage, [`Error::Capture`](crate::error::Error::Capture) for photographs that [`Scene::several`] refuses, and those of [`refine`](crate::refine).
pub fn refine_several(
    scene: &Scene,
    stages: Stages<'_>,
    config: &Config,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    PreparedScene::new(scene, &stages, config, callback)?.once().refine(scene.reference, stages, callback)
}
