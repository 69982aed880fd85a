//! The reference's depth in the prior's unit, with its standard deviation.

use crate::Result;
use crate::augmentation::Component;
use mde_mvs::consensus::{Reconstruction, ViewDepth};
use mde_nerf::RenderedView;
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Zip};

/// Factors of the standard deviations of the field's termination and of the fused depth.
const SIGMA: [f32; 2] = [2.0, 0.5];
/// Least share of the reference's pixels that another photograph confirms.
const LEAST_VERIFIED: f32 = 0.03;

/// Why the photographs carry no depth, if they do not.
pub(super) fn unusable(reconstruction: &Reconstruction) -> Option<String> {
    let Some(reference) = reconstruction.views.first() else { return Some("no photograph is left".into()) };
    (reference.verified < LEAST_VERIFIED).then(|| {
        format!(
            "other photographs confirm the depth of {:.1} % of the pixels, {:.0} % are needed; take sharper photographs, or from further aside",
            100.0 * reference.verified,
            100.0 * LEAST_VERIFIED
        )
    })
}

/// Unit of the poses per unit of the prior, and the standard deviation of its logarithm.
pub(super) fn scale(reconstruction: &Reconstruction, unit: f64) -> [f64; 2] {
    reconstruction.scale.map_or([unit, f64::INFINITY], |s| [unit * s.log_scale.exp(), s.variance.sqrt()])
}

/// The field's depth, the consensus where the field has none, in the prior's unit. The variance adds what the ray's
/// termination and the consensus state, times the factors of [`SIGMA`].
pub(super) fn combine(
    reconstruction: &Reconstruction,
    rendered: Option<&RenderedView>,
    unit: f64,
) -> Result<(GaussianDepth, Vec<Component>)> {
    let Some(ViewDepth { fused: consensus, .. }) = reconstruction.views.first() else {
        return Ok((GaussianDepth::missing(0, 0), Vec::new()));
    };
    let factor = scale(reconstruction, unit)[0] as f32;
    let (mut mean, mut variance) = (consensus.mean().to_owned(), consensus.variance().to_owned());
    let mut parts =
        [Array2::from_elem(mean.dim(), f32::INFINITY), Array2::from_elem(mean.dim(), f32::INFINITY)];
    for (at, mean) in mean.indexed_iter_mut() {
        let relative = |map: &GaussianDepth| map.get(at.0, at.1).map(|(z, v)| (z, v.sqrt() / z));
        let field = rendered.and_then(|r| relative(&r.depth)).filter(|(z, _)| *z > 0.0);
        let stated = relative(consensus).filter(|(z, _)| *z > 0.0);
        let z = match (field, stated) {
            (Some((z, _)), _) | (None, Some((z, _))) => z,
            (None, None) => {
                (*mean, variance[at]) = (0.0, f32::INFINITY);
                continue;
            }
        };
        let depth = z / factor;
        let shares = [SIGMA[0] * field.map_or(0.0, |f| f.1), SIGMA[1] * stated.map_or(0.0, |s| s.1)];
        for (part, share) in parts.iter_mut().zip(shares) {
            part[at] = share * depth;
        }
        *mean = depth;
        let share = shares.iter().map(|s| s * s).sum::<f32>();
        variance[at] = (share * depth * depth).max(f32::MIN_POSITIVE);
    }
    let [field, consensus] = parts;
    let components =
        vec![Component { name: "field", sigma: field }, Component { name: "consensus", sigma: consensus }];
    Zip::from(&mut variance).and(&mut mean).for_each(|v, z| {
        if !(v.is_finite() && z.is_finite()) {
            (*v, *z) = (f32::INFINITY, 0.0);
        }
    });
    Ok((GaussianDepth::new(mean, variance)?, components))
}
