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
