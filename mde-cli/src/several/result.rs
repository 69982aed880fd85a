//! The reference's depth in the prior's unit, with its standard deviation.

use crate::error::Result;
use crate::reports::prediction::Component;
use mde_fusion::{Fused, Fuser, Prior};
use mde_mvs::consensus::{Reconstruction, ViewDepth};
use mde_mvs::patches::refine_by_patches;
use mde_mvs::planes::with_planes;
use mde_nerf::RenderedView;
use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, Zip};

/// Least share of the reference's pixels that another photograph confirms.
const LEAST_VERIFIED: f32 = 0.03;

/// Why the photographs carry no depth, if they do not.
pub(super) fn unusable(reference: &ViewDepth) -> Option<String> {
    (reference.verified < LEAST_VERIFIED).then(|| {
        format!(
            "other photographs confirm the depth of {:.1} % of the pixels, {:.0} % are needed: plain or blurred surfaces, or too small a move, do not match",
            100.0 * reference.verified,
            100.0 * LEAST_VERIFIED
        )
    })
}

/// Unit of the poses per unit of the prior, and the standard deviation of its logarithm.
pub(super) fn scale(reconstruction: &Reconstruction, unit: f64) -> [f64; 2] {
    reconstruction.scale.map_or([unit, f64::INFINITY], |s| [unit * s.log_scale.exp(), s.variance.sqrt()])
}

/// The fusion of the prior with the field in the order of the paper, the field brought into the prior's unit by `factor` first.
pub(super) fn printed(
    fuser: &dyn Fuser,
    prior: &Array2<f32>,
    rendered: &RenderedView,
    factor: f64,
) -> Result<Fused> {
    let factor = factor as f32;
    let seen = rendered.depth.clone().map(|mean, variance| (mean / factor, variance / (factor * factor)));
    Ok(fuser.fuse(&Prior::new(prior.clone())?, &[seen])?)
}

/// The depth with the planes of its surfaces, then refined by patches against the other photographs and their consensus; the components are
/// in proportion to sigma.
pub(super) fn refined(
    depth: &GaussianDepth,
    components: &mut [Component],
    views: &[PosedView],
    others: &[GaussianDepth],
    factor: f64,
) -> Result<GaussianDepth> {
    let factor = factor as f32;
    let (mean, variance) = with_planes(&views[0], depth)?.into_parts();
    let own = mean.mapv(|z| z * factor);
    let maps: Vec<_> = std::iter::once(own.view()).chain(others.iter().map(|other| other.mean())).collect();
    let refined = refine_by_patches(views, &maps)?;
    let ratio = Zip::from(&refined).and(&own).map_collect(|z, was| if *was > 0.0 { z / was } else { 1.0 });
    let refined = GaussianDepth::new(mean * &ratio, variance * &ratio * &ratio)?;
    let ratio = Zip::from(refined.variance())
        .and(depth.variance())
        .map_collect(|v, was| if was.is_finite() { (v / was).sqrt() } else { 1.0 });
    components.iter_mut().for_each(|component| component.sigma *= &ratio);
    Ok(refined)
}

/// The depth with sigma and its components times a factor.
pub(super) fn with_sigma(
    depth: GaussianDepth,
    components: &mut [Component],
    factor: &Array2<f32>,
) -> Result<GaussianDepth> {
    components.iter_mut().for_each(|component| component.sigma *= factor);
    let (mean, variance) = depth.into_parts();
    Ok(GaussianDepth::new(mean, variance * factor * factor)?)
}
