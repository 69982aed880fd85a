use crate::error::in_range;
use crate::mesh::Mesh;
use crate::pose::Transfer;
use crate::view::check_map;
use crate::zbuffer::{Hit, front};
use crate::{PinholeCamera, Pose, Result};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Zip};

/// Which samples of a depth map reach another camera, and what their variance is there.
///
/// The default is what the paper says, and what its z-buffer needs; `lateral` and `drop_flying` go beyond it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct ReprojectConfig {
    /// Neighbouring pixels are on two surfaces where their disparities 1/z differ by more than this share of the larger.
    /// Samples further apart than this are never combined.
    pub tear: f64,
    /// Samples this close behind the front one, as a share of its depth, belong to it.
    pub front: f64,
    /// Samples this many standard deviations of the front one behind it belong to it too, as far as `tear` allows.
    pub front_sigmas: f64,
    /// Adds \\( |\nabla z'|^2 \\, |\partial (u', v') / \partial z|^2 \\, \sigma^2 \\): a sample that slides sideways when its
    /// depth changes is unsure where the depth is steep, most of all at edges.
    pub lateral: bool,
    /// Leaves out source pixels that hang between two surfaces: those whose 3 x 3 neighbourhood spans more than
    /// `flying_range` and whose own sigma is more than `flying_sigma`.
    pub drop_flying: bool,
    /// Range of disparity in a 3 x 3 neighbourhood, as a share of its largest.
    pub flying_range: f64,
    /// Standard deviation, as a share of the depth.
    pub flying_sigma: f64,
}

impl Default for ReprojectConfig {
    fn default() -> Self {
        Self {
            tear: 0.05,
            front: 0.01,
            front_sigmas: 3.0,
            lateral: false,
            drop_flying: false,
            flying_range: 0.05,
            flying_sigma: 0.02,
        }
    }
}

impl ReprojectConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) with the first field at fault.
    pub fn validate(&self) -> Result<()> {
        in_range("tear", self.tear, [0.0, 1.0], "in 0 to 1 (a share of the disparity; 0.05 is usual)")?;
        in_range("front", self.front, [0.0, 1.0], "in 0 to 1 (a share of the depth; 0.01 is usual)")?;
        in_range("front-sigmas", self.front_sigmas, [0.0, f64::MAX], "finite and >= 0 (3 is usual)")?;
        in_range("flying-range", self.flying_range, [0.0, 1.0], "in 0 to 1 (a share of the disparity)")?;
        in_range("flying-sigma", self.flying_sigma, [0.0, f64::MAX], "finite and >= 0 (a share of the depth)")
    }
}

/// A Gaussian depth map as another camera sees it (Section III.D: \\( \mu^{(j)}, (\sigma_r^2)^{(j)} \\) of a rendered view
/// in the original one).
///
/// A depth \\( z \\) along the ray \\( d \\) (z = 1) of a source pixel becomes \\( z' = (e_z^\top R d)\, z + t_z \\), which is
/// affine, so the Gaussian stays one:
///
/// \\[ \mu' = (e_z^\top R d)\, \mu + t_z, \qquad \sigma'^2 = (e_z^\top R d)^2 \sigma^2 . \\]
///
/// The map is rasterised as in [`forward_warp`](crate::forward_warp), so a result stands at its pixel's centre (planes come
/// out exactly) and no result lies between two surfaces. Where the surface folds, a pixel may get several samples \\( j \\)
/// near the front one ([`ReprojectConfig::front`]). They come from one map and are not independent, so they make a
/// mixture and their precisions do not add:
///
/// \\[ \mu' = \sum_j \omega_j \mu_j', \qquad \sigma'^2 = \sum_j \omega_j \left( \sigma_j'^2 + (\mu_j' - \mu')^2 \right),
/// \qquad \omega_j \propto 1 / \sigma_j'^2 . \\]
///
/// A pixel that nothing of the source reaches is missing.
///
/// ```
/// use mde_warp::{PinholeCamera, Pose, ReprojectConfig, ndarray::Array2, reproject};
/// use mde_uncertainty::GaussianDepth;
///
/// let camera = PinholeCamera::from_fov(60.0, 8, 6)?;
/// let depth = GaussianDepth::new(Array2::from_elem((6, 8), 2.0), Array2::from_elem((6, 8), 0.01))?;
/// let forward = Pose::translation(0.0, 0.0, -0.5); // the camera half a metre ahead
/// let seen = reproject(&depth, &camera, &Pose::identity(), &camera, &forward, &ReprojectConfig::default())?;
/// assert_eq!(seen.get(3, 4), Some((1.5, 0.01)));
/// # Ok::<(), mde_warp::Error>(())
/// ```
///
/// # Errors
/// A setting, camera or pose out of range, or a map that has not the size of `camera`.
pub fn reproject(
    depth: &GaussianDepth,
    camera: &PinholeCamera,
    pose: &Pose,
    target_camera: &PinholeCamera,
    target: &Pose,
    config: &ReprojectConfig,
) -> Result<GaussianDepth> {
    config.validate()?;
    let transfer = Transfer::new((camera, pose), (target_camera, target))?;
    check_map("depth", depth.dim(), camera)?;

    let keep = |row, column| !(config.drop_flying && is_flying(depth, row, column, config));
    let mesh = Mesh::new(depth, transfer, config.tear, keep);
    let mixtures = combine(&mesh, depth, config);

    let (mut mean, mut variance) =
        GaussianDepth::missing(target_camera.height, target_camera.width).into_parts();
    Zip::from(&mixtures).and(&mut mean).and(&mut variance).for_each(|mixture, mean, variance| {
        if let Some((m, v)) = mixture.moments() {
            (*mean, *variance) = (m, v);
        }
    });
    if config.lateral {
        let slopes = Array2::from_shape_fn(mean.dim(), |at| steepest(&mean, &variance, at));
        Zip::from(&mixtures).and(&slopes).and(&mut variance).for_each(|mixture, slope, variance| {
            let extra = slope * slope * mixture.slide();
            // Not so for a NaN, which comes of a slope of 0 and a slide that overflows.
            if extra > 0.0 {
                *variance += extra as f32;
            }
        });
    }
    Ok(GaussianDepth::new(mean, variance)?)
}

/// The front of every target pixel, and then all samples that belong to it.
fn combine(mesh: &Mesh, depth: &GaussianDepth, config: &ReprojectConfig) -> Array2<Mixture> {
    let transfer = mesh.transfer();
    let mut mixtures = front(mesh).mapv(|hit| Mixture::behind(&hit, depth, transfer, config));
    mesh.rasterise(|sample, place| {
        if let Some(mixture) = mixtures.get_mut((sample.row, sample.column))
            && sample.inverse_depth >= mixture.last
            && (place.is_joined() || !mixture.joined)
        {
            let hit = Hit { inverse_depth: sample.inverse_depth, u: sample.u, v: sample.v, place };
            let variance = hit.source_variance(depth);
            let gain = transfer.gain(hit.u, hit.v);
            let drift = if config.lateral { transfer.drift(&sample).norm_squared() } else { 0.0 };
            mixture.add(hit.depth(), gain * gain * variance, drift * variance);
        }
    });
    mixtures
}

/// The samples of one surface at one pixel, about the depth of the front one.
#[derive(Debug, Clone, Copy, Default)]
struct Mixture {
    /// z of the front sample, 0 where there is none.
    front: f64,
    /// Inverse depth of the last place that still belongs to the front; infinite where there is none.
    last: f64,
    /// Whether the front is a surface between pixels; what is only continued from a pixel then adds nothing.
    joined: bool,
    weight: f64,
    /// Weighted sums of the offset from the front, its square, the variance and the squared sideways motion.
    offset: f64,
    square: f64,
    variance: f64,
    slide: f64,
}

impl Mixture {
    /// An empty mixture that takes what is not too far behind `hit`.
    fn behind(hit: &Hit, source: &GaussianDepth, transfer: &Transfer, config: &ReprojectConfig) -> Self {
        if hit.is_empty() {
            return Self { last: f64::INFINITY, ..Self::default() };
        }
        let front = hit.depth();
        let sigma = transfer.gain(hit.u, hit.v).abs() * hit.source_variance(source).sqrt();
        let depth = front + (config.front * front).max(config.front_sigmas * sigma);
        let last = depth.recip().max(hit.inverse_depth * (1.0 - config.tear));
        let joined = hit.place.is_joined();
        Self { front, last: last.min(hit.inverse_depth), joined, ..Self::default() }
    }

    /// A sample of z, its variance, and its squared sideways standard deviation in pixels.
    fn add(&mut self, depth: f64, variance: f64, slide: f64) {
        let offset = depth - self.front;
        // The floor keeps a variance of 0 from taking all the weight there is.
        let weight = (variance + (1e-6 * self.front).powi(2)).recip();
        self.weight += weight;
        self.offset += weight * offset;
        self.square += weight * offset * offset;
        self.variance += weight * variance;
        self.slide += weight * slide;
    }

    fn moments(&self) -> Option<(f32, f32)> {
        let offset = self.offset / self.weight;
        let mean = (self.front + offset) as f32;
        let spread = (self.square / self.weight - offset * offset).max(0.0);
        let variance = (self.variance / self.weight + spread) as f32;
        (mean > 0.0 && mean.is_finite() && variance.is_finite()).then_some((mean, variance))
    }

    /// Squared sideways standard deviation, pixels squared.
    fn slide(&self) -> f64 {
        if self.weight > 0.0 { self.slide / self.weight } else { 0.0 }
    }
}

/// Largest difference of depth to a neighbour in the row and in the column, combined; per pixel.
fn steepest(mean: &Array2<f32>, variance: &Array2<f32>, (row, column): (usize, usize)) -> f64 {
    let known = |row: usize, column: usize| {
        let finite = variance.get((row, column)).is_some_and(|v| v.is_finite());
        finite.then(|| f64::from(mean[(row, column)]))
    };
    let Some(here) = known(row, column) else { return 0.0 };
    let largest = |neighbours: [(usize, usize); 2]| {
        let depths = neighbours.into_iter().filter_map(|(r, c)| known(r, c));
        depths.map(|d| (d - here).abs()).fold(0.0, f64::max)
    };
    let x = largest([(row, column.wrapping_sub(1)), (row, column + 1)]);
    let y = largest([(row.wrapping_sub(1), column), (row + 1, column)]);
    x.hypot(y)
}

/// Whether a pixel hangs between two surfaces: an uncertain one in a neighbourhood of very different depths.
fn is_flying(depth: &GaussianDepth, row: usize, column: usize, config: &ReprojectConfig) -> bool {
    let Some((mean, variance)) = depth.get(row, column) else { return false };
    if f64::from(variance).sqrt() <= config.flying_sigma * f64::from(mean) {
        return false;
    }
    let rows = row.saturating_sub(1)..=row + 1;
    let neighbours = rows.flat_map(|r| (column.saturating_sub(1)..=column + 1).map(move |c| (r, c)));
    let depths = neighbours.filter_map(|(r, c)| Some(depth.get(r, c)?.0)).filter(|&d| d > 0.0);
    let (low, high) = depths.fold((f32::INFINITY, 0.0_f32), |(l, h), d| (l.min(d), h.max(d)));
    // In disparity the range over the largest is 1 - near / far.
    1.0 - f64::from(low) / f64::from(high) > config.flying_range
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mixture(samples: &[(f64, f64)]) -> (f32, f32) {
        let mut mixture = Mixture { front: samples[0].0, ..Mixture::default() };
        samples.iter().for_each(|&(depth, variance)| mixture.add(depth, variance, 0.0));
        mixture.moments().unwrap()
    }

    #[test]
    fn the_same_sample_again_says_nothing_new() {
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
