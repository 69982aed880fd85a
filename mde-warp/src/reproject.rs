use crate::error::in_range;
use crate::mesh::Mesh;
use crate::pose::check_cameras;
use crate::transfer::Transfer;
use crate::zbuffer::{Hit, front};
use crate::{PinholeCamera, Pose, Result};
use mde_uncertainty::GaussianDepth;

/// Settings of [`reproject`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct ReprojectConfig {
    /// Relative difference of disparity 1/z above which neighbouring pixels belong to two surfaces, as a share of the
    /// larger. Samples further apart than this are never combined.
    pub tear: f64,
    /// Depth behind the front sample, as a share of its depth, up to which samples are combined with it.
    pub front: f64,
    /// The same limit in standard deviations of the front sample; the larger of the two counts, as far as `tear` allows.
    pub front_sigmas: f64,
}

impl Default for ReprojectConfig {
    fn default() -> Self {
        Self { tear: 0.05, front: 0.01, front_sigmas: 3.0 }
    }
}

impl ReprojectConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) with the first field at fault.
    pub fn validate(&self) -> Result<()> {
        in_range("tear", self.tear, [0.0, 1.0], "give 0 to 1 (a share of the disparity; 0.05 is usual)")?;
        in_range("front", self.front, [0.0, 1.0], "give 0 to 1 (a share of the depth; 0.01 is usual)")?;
        in_range("front-sigmas", self.front_sigmas, [0.0, f64::MAX], "give a finite number >= 0 (3 is usual)")
    }
}

/// Reprojects a Gaussian depth map into another camera (Section III.D: \\( \mu^{(j)}, (\sigma_r^2)^{(j)} \\) of a rendered
/// view in the original one).
///
/// A depth \\( z \\) along the ray \\( d \\) (z = 1) of a source pixel becomes \\( z' = (e_z^\top R d)\, z + t_z \\), which is
/// affine, so the Gaussian stays one:
///
/// \\[ \mu' = (e_z^\top R d)\, \mu + t_z, \qquad \sigma'^2 = (e_z^\top R d)^2 \sigma^2 . \\]
///
/// The map is rasterised as in [`forward_warp`](crate::forward_warp): results are at pixel centres (planes are exact) and none lies between
/// two surfaces. Where the surface folds, a pixel may get several samples \\( j \\) near the front one ([`ReprojectConfig::front`]). They
/// come from one map and are not independent, so they form a mixture and their precisions do not add:
///
/// \\[ \mu' = \sum_j \omega_j \mu_j', \qquad \sigma'^2 = \sum_j \omega_j \left( \sigma_j'^2 + (\mu_j' - \mu')^2 \right),
/// \qquad \omega_j \propto 1 / \sigma_j'^2 . \\]
///
/// A pixel that no source sample reaches is missing.
///
/// ```
/// use mde_warp::{PinholeCamera, Pose, ReprojectConfig, ndarray::Array2, reproject};
/// use mde_uncertainty::GaussianDepth;
///
/// let camera = PinholeCamera::from_fov(60.0, 8, 6)?;
/// let depth = GaussianDepth::new(Array2::from_elem((6, 8), 2.0), Array2::from_elem((6, 8), 0.01))?;
/// let forward = Pose::translation(0.0, 0.0, -0.5); // the camera half a metre ahead
/// let projected = reproject(&depth, &camera, &Pose::identity(), &camera, &forward, &ReprojectConfig::default())?;
/// assert_eq!(projected.get(3, 4), Some((1.5, 0.01)));
/// # Ok::<(), mde_warp::Error>(())
/// ```
///
/// # Errors
/// [`Error::Config`](crate::Error::Config), [`Error::Camera`](crate::Error::Camera) or [`Error::Pose`](crate::Error::Pose) for a value out
/// of range, [`Error::Shape`](crate::Error::Shape) for a map that is not of `camera`'s size.
pub fn reproject(
    depth: &GaussianDepth,
    camera: &PinholeCamera,
    pose: &Pose,
    target_camera: &PinholeCamera,
    target: &Pose,
    config: &ReprojectConfig,
) -> Result<GaussianDepth> {
    config.validate()?;
    check_cameras((camera, pose), (target_camera, target))?;
    let transfer = Transfer::between((camera, pose), (target_camera, target));
    camera.check_map("depth", depth.dim())?;

    let mesh = Mesh::new(depth, transfer, config.tear);
    let mut mixtures = front(&mesh).mapv(|hit| Mixture::behind(&hit, depth, &transfer, config));
    mesh.rasterise(|pixel, hit| {
        if let Some(mixture) = mixtures.get_mut(pixel)
            && hit.inverse_depth >= mixture.last
            && (hit.patch.is_joined() || !mixture.joined)
        {
            let variance = hit.source_variance(depth);
            let gain = transfer.gain(hit.u, hit.v);
            mixture.add(hit.depth(), gain * gain * variance);
        }
    });
    let moments = mixtures.mapv(|mixture| mixture.moments().unwrap_or((0.0, f32::INFINITY)));
    Ok(GaussianDepth::new(moments.mapv(|m| m.0), moments.mapv(|m| m.1))?)
}

/// The samples of one surface at one pixel, about the depth of the front one.
#[derive(Debug, Clone, Copy, Default)]
struct Mixture {
    /// z of the front sample, 0 where there is none.
    front: f64,
    /// Least inverse depth that still belongs to the front; infinite where there is none.
    last: f64,
    /// Whether the front is interpolated between pixels; samples extrapolated from one pixel are then left out.
    joined: bool,
    weight: f64,
    /// Weighted sums of the offset from the front, its square, and the variance.
    offset: f64,
    square: f64,
    variance: f64,
}

impl Mixture {
    /// An empty mixture for the samples that are not too far behind `hit`.
    fn behind(hit: &Hit, source: &GaussianDepth, transfer: &Transfer, config: &ReprojectConfig) -> Self {
        if hit.is_empty() {
            return Self { last: f64::INFINITY, ..Self::default() };
        }
        let front = hit.depth();
        let sigma = transfer.gain(hit.u, hit.v).abs() * hit.source_variance(source).sqrt();
        let depth = front + (config.front * front).max(config.front_sigmas * sigma);
        let last = depth.recip().max(hit.inverse_depth * (1.0 - config.tear));
        let joined = hit.patch.is_joined();
        Self { front, last: last.min(hit.inverse_depth), joined, ..Self::default() }
    }

    /// Adds a sample of z and its variance.
    fn add(&mut self, depth: f64, variance: f64) {
        let offset = depth - self.front;
        // The floor keeps the weight of a variance of 0 finite.
        let weight = (variance + (1e-6 * self.front).powi(2)).recip();
        self.weight += weight;
        self.offset += weight * offset;
        self.square += weight * offset * offset;
        self.variance += weight * variance;
    }

    fn moments(&self) -> Option<(f32, f32)> {
        let offset = self.offset / self.weight;
        let mean = (self.front + offset) as f32;
        let spread = (self.square / self.weight - offset * offset).max(0.0);
        let variance = (self.variance / self.weight + spread) as f32;
        (mean > 0.0 && mean.is_finite() && variance.is_finite()).then_some((mean, variance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mixture(samples: &[(f64, f64)]) -> (f32, f32) {
        let mut mixture = Mixture { front: samples[0].0, ..Mixture::default() };
        samples.iter().for_each(|&(depth, variance)| mixture.add(depth, variance));
        mixture.moments().unwrap()
    }

    #[test]
    fn repeated_samples_leave_the_mixture_unchanged() {
        assert_eq!(mixture(&[(2.0, 0.25); 6]), (2.0, 0.25));
        assert_eq!(mixture(&[(2.0, 0.0); 3]), (2.0, 0.0));
    }

    #[test]
    fn samples_that_disagree_widen_each_other() {
        let (mean, variance) = mixture(&[(2.0, 0.25), (3.0, 0.25)]);
        assert!((mean - 2.5).abs() < 1e-6 && (variance - 0.5).abs() < 1e-6);
        let (mean, variance) = mixture(&[(2.0, 0.1), (3.0, 0.3)]);
        assert!((mean - 2.25).abs() < 1e-6 && (variance - (0.15 + 0.1875)).abs() < 1e-6);
    }
}
