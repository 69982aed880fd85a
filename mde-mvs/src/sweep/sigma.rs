//! The depth of several photographs and its standard deviation: consensus and field in one.

use super::consensus::ViewDepth;
use crate::poses::depth_variance;
use crate::{Result, centre};
use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use nalgebra::DMatrix;
use ndarray::Array2;

/// Factor of the variances of the consensus and of edges beside a field, which has them in part already.
const CONSENSUS: f32 = 0.25;
/// Standard deviation of a match, pixels of disparity. What neither the field nor the sweeps state: exposure, the raster, the lens.
const MATCH: f64 = 0.5;
/// What sigma is made of.
pub const COMPONENTS: [&str; 8] =
    ["termination", "in-bin", "ambiguity", "prior", "view-disagreement", "parallax", "poses", "edges"];
/// Standard deviation of log depth per range of it in [`NEIGHBOURS`]: the place of an edge is known to a few pixels.
const EDGE: f32 = 0.25;
/// Half the side of the square of that range, as a share of the longer side.
const NEIGHBOURS: f32 = 4.0 / 320.0;

/// The mean of the log depth of a field and of the consensus of the first of the views by precision (Eq. 7), or the one that there is, and
/// the standard deviations of its parts, `[height, width]`, in the order of [`COMPONENTS`]. The consensus and the `field`, its depth and
/// the part of its variance that lies within the bins of a ray, are in the unit of the poses; the result is in one of which that is
/// `factor` times.
///
/// Relative variances add: that of the ray's termination, a quarter of the consensus' (all of it where there is no field), half a pixel of
/// disparity over the root mean square of the baselines \\( b \\), \\( (0.5\, z / (f_x b))^2 \\), that of the poses ([`depth_variance`]), and the square of a quarter of
/// the range of log depth over 9 x 9 pixels of a photograph of 320 (an eighth beside a field). The components
/// split the first two: the ray's into what lies within its bins and the rest, the consensus' into the ambiguity of the costs, the
/// prior with the doubt of the match, and the inflation by which the photographs disagree.
///
/// # Errors
/// [`Error::Depth`](crate::Error::Depth) for maps of different sizes; those of [`depth_variance`].
pub fn combine(
    ViewDepth { fused: consensus, ambiguity, .. }: &ViewDepth,
    inflation: f32,
    views: &[PosedView],
    covariance: &DMatrix<f64>,
    field: Option<(&GaussianDepth, Option<&Array2<f32>>)>,
    factor: f64,
) -> Result<(GaussianDepth, [Array2<f32>; COMPONENTS.len()])> {
    let factor = factor as f32;
    let mut mean = Array2::zeros(consensus.dim());
    let mut variance = Array2::from_elem(consensus.dim(), f32::INFINITY);
    let per_depth = disparity(views) as f32;
    let of_poses = depth_variance(views, covariance, consensus.mean())?;
    let disagreement = 1.0 - inflation.recip();
    let (rendered, within) = field.map_or((None, None), |(depth, within)| (Some(depth), within));
    let known = |map: &GaussianDepth, (y, x)| map.get(y, x).filter(|(z, _)| *z > 0.0);
    let depth = Array2::from_shape_fn(mean.dim(), |at| {
        rendered.and_then(|map| known(map, at)).or(known(consensus, at)).map_or(0.0, |(z, _)| z)
    });
    let range = log_range(&depth);
    let mut parts = COMPONENTS.map(|_| Array2::from_elem(mean.dim(), f32::INFINITY));
    for (at, mean) in mean.indexed_iter_mut() {
        let relative = |map: &GaussianDepth| known(map, at).map(|(z, v)| (z, v.sqrt() / z));
        let (field, stated) = (rendered.and_then(relative), relative(consensus));
        let fused = stated.map_or(0.0, |s| s.1 * s.1);
        let edge = (EDGE * range[at]).powi(2);
        let ray = field.map_or(0.0, |f| f.1 * f.1);
        let common = |z: f32| (per_depth * z).powi(2) + of_poses[at];
        let z = match (field, stated) {
            (Some((z, _)), Some((known, _))) => {
                let of_field = (ray + CONSENSUS * (fused + edge) + common(z)).recip();
                // Beside an edge the consensus is the fatter of the two: the whole range counts as its deviation.
                let of_consensus = (fused + range[at].powi(2) + common(known)).recip();
                ((of_field * z.ln() + of_consensus * known.ln()) / (of_field + of_consensus)).exp()
            }
            (Some((z, _)), None) | (None, Some((z, _))) => z,
            (None, None) => continue,
        };
        let depth = z / factor;
        let in_bin = within.and_then(|w| w.get(at)).map_or(0.0, |v| (v / (z * z)).max(0.0).min(ray));
        let share = if field.is_some() { CONSENSUS } else { 1.0 };
        let (fused, edge) = (share * fused, share * edge);
        let apart = disagreement * fused;
        let ambiguous = ambiguity[at] * (fused - apart);
        let shares = [
            ray - in_bin,
            in_bin,
            ambiguous,
            (fused - apart - ambiguous).max(0.0),
            apart,
            (per_depth * z).powi(2),
            of_poses[at],
            edge,
        ];
        for (part, share) in parts.iter_mut().zip(shares) {
            part[at] = share.sqrt() * depth;
        }
        let share = ray + fused + (per_depth * z).powi(2) + of_poses[at] + edge;
        let total = (share * depth * depth).max(f32::MIN_POSITIVE);
        if total.is_finite() && depth.is_finite() {
            (*mean, variance[at]) = (depth, total);
        }
    }
    Ok((GaussianDepth::new(mean, variance)?, parts))
}

/// The range of the logarithm of the known depths over a square about each pixel.
fn log_range(depth: &Array2<f32>) -> Array2<f32> {
    let (height, width) = depth.dim();
    let reach = (NEIGHBOURS * height.max(width) as f32).round() as usize;
    let ends = depth.mapv(|z| if z > 0.0 { [z, z] } else { [f32::INFINITY, 0.0] });
    let widest = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
    let along = |ends: &Array2<[f32; 2]>, axis: usize| {
        Array2::from_shape_fn((height, width), |(y, x)| {
            let (at, side) = if axis == 0 { (y, height) } else { (x, width) };
            let near = at.saturating_sub(reach)..(at + reach + 1).min(side);
            near.map(|i| ends[if axis == 0 { (i, x) } else { (y, i) }]).fold(ends[(y, x)], widest)
        })
    };
    along(&along(&ends, 1), 0).mapv(|[near, far]| if far > 0.0 { (far / near).ln() } else { 0.0 })
}

/// Relative standard deviation per unit of depth of a match that is [`MATCH`] pixels off, over the root mean square baseline.
fn disparity(views: &[PosedView]) -> f64 {
    let Some((reference, others)) = views.split_first() else { return 0.0 };
    let here = centre(&reference.pose);
    let squares: f64 = others.iter().map(|view| (centre(&view.pose) - here).norm_squared()).sum();
    let baseline = (squares / others.len().max(1) as f64).sqrt();
    if baseline > 0.0 { MATCH / (reference.camera.fx * baseline) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consensus::reconstruct;
    use crate::silent;
    use crate::synthetic::{Plane, scene};

    /// A step: beside it the whole of it is doubted, away from it nothing.
    #[test]
    fn the_range_of_depth_is_that_of_the_neighbours() {
        let reach = 2;
        let depth = Array2::from_shape_fn((20, 160), |(y, x)| match (y, x) {
            (0, 0) => 0.0,
            (_, x) if x < 80 => 1.0,
            _ => 2.0,
        });
        let range = log_range(&depth);
        for ((_, x), range) in range.indexed_iter() {
            let beside = (80 - reach..80 + reach).contains(&x);
            assert_eq!(*range, if beside { 2.0_f32.ln() } else { 0.0 }, "{x}");
        }
    }

    /// Two photographs of a wall. No field states a part of the variance, so sigma has all of it.
    #[test]
    fn without_a_field_sigma_has_the_whole_variance_of_the_consensus() {
        let (views, priors) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (48, 64), &[[0.0; 3], [0.2, 0.0, 0.0]]);
        let priors = [priors[0].view(), priors[1].view()];
        let found = reconstruct(&views, &priors, None, &mut silent).unwrap();
        let (_, parts) =
            combine(&found.views[0], found.inflation, &views, &DMatrix::zeros(6, 6), None, 1.0).unwrap();
        let of_fused = ["ambiguity", "prior", "view-disagreement"];
        let fused = COMPONENTS.iter().zip(&parts).filter(|(name, _)| of_fused.contains(name));
        let fused = fused.map(|(_, sigma)| sigma.mapv(|sigma| sigma * sigma)).reduce(|a, b| a + b).unwrap();
        let stated = found.views[0].fused.variance();
        assert!(fused.iter().zip(stated).all(|(sum, all)| (sum / all - 1.0).abs() < 1e-3));
    }
}
