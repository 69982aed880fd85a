//! The modelled volume: the original camera's frustum between near and far, mapped to the unit cube.

use crate::config::SamplingConfig;
use crate::scalar::Scalar;
use crate::{Error, Result};
use mde_uncertainty::Real;
use mde_uncertainty::statistics::nearest_rank_sorted;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Point2, Point3, Vector3};

/// Quantiles of the hypotheses' depths, and the factors from them to near and far.
const QUANTILES: [f64; 2] = [0.005, 0.995];
const STRETCH: [f64; 2] = [0.8, 1.25];

/// Maps the world to \\((u, v, s) \in [0, 1]^3\\): the original camera's pixel coordinates, with the margin that holds the
/// other views, and \\(s = (1/z - 1/far) / (1/near - 1/far)\\).
///
/// The map is projective: rays stay straight, cells match pixels, and no cell lies outside all views.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct Frustum {
    /// World to the original camera, row-major rotation and translation.
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    /// Per image axis: cube coordinate = scale * (x / z) + offset.
    scale: [f64; 2],
    offset: [f64; 2],
    pub(crate) near: f64,
    pub(crate) far: f64,
    /// The unit of path lengths: the scene's median depth.
    pub(crate) unit: f64,
}

/// A ray parametrised by z-depth in its camera: the point at depth z is `origin + z * direction`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: Point3<f64>,
    /// World direction with unit z in the camera.
    pub(crate) direction: Vector3<f64>,
}

/// A ray in cube coordinates: \\((u, v, s)\\ at inverse depth \\(\lambda\\ is \\((a + \lambda b) / g\\ with
/// \\(g = g_0 + \lambda g_1\\).
#[derive(Debug, Clone, Copy)]
pub(crate) struct CubeRay<T> {
    constant: [T; 3],
    slope: [T; 3],
    denominator: [T; 2],
    /// Lower bound of \\(g / \lambda\\), the depth in the original camera.
    nearest: T,
}

impl<T: Real> CubeRay<T> {
    /// The cube coordinates at an inverse depth; points outside are clamped to the cube's surface.
    #[inline(always)]
    pub(crate) fn cube(&self, inverse_depth: T) -> [T; 3] {
        let g = self.denominator[0] + inverse_depth * self.denominator[1];
        let inverse = T::ONE / g.max(self.nearest * inverse_depth);
        std::array::from_fn(|axis| {
            let q = (self.constant[axis] + inverse_depth * self.slope[axis]) * inverse;
            q.max(T::ZERO).min(T::ONE)
        })
    }
}

impl Ray {
    /// The ray of a pixel of a posed camera.
    pub(crate) fn new(camera: &PinholeCamera, pose: &Pose, x: f64, y: f64) -> Self {
        let inverse = pose.inverse();
        Self { origin: inverse * Point3::origin(), direction: inverse * camera.ray(Point2::new(x, y)) }
    }
}

impl Frustum {
    /// The frustum of `views[0]`, wide enough for the frusta of all views between near and far.
    pub(crate) fn of_views(views: &[PosedView], sampling: &SamplingConfig) -> Result<Self> {
        let original = views.first().ok_or(Error::NoPixels)?;
        let (near, far, unit) = depth_range(original, sampling)?;
        let rotation = original.pose.rotation.to_rotation_matrix();
        let m = rotation.matrix();
        let mut frustum = Self {
            rotation: std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)])),
            translation: original.pose.translation.vector.into(),
            scale: [1.0; 2],
            offset: [0.0; 2],
            near,
            far,
            unit,
        };
        // The image of a convex hull is the hull of the corners' images while all of them lie in front.
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for view in views {
            let (right, bottom) = (view.camera.width as f64 - 0.5, view.camera.height as f64 - 0.5);
            for (x, y) in [(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)] {
                let ray = Ray::new(&view.camera, &view.pose, x, y);
                for z in [near, far] {
                    let p = original.pose * (ray.origin + z * ray.direction);
                    if p.z < 0.5 * near {
                        continue;
                    }
                    for (axis, value) in [p.x / p.z, p.y / p.z].into_iter().enumerate() {
                        low[axis] = low[axis].min(value);
                        high[axis] = high[axis].max(value);
                    }
                }
            }
        }
        for axis in 0..2 {
            frustum.scale[axis] = 1.0 / (high[axis] - low[axis]).max(1e-9);
            frustum.offset[axis] = -low[axis] * frustum.scale[axis];
        }
        Ok(frustum)
    }

    /// A ray in cube coordinates.
    pub(crate) fn cube_ray<T: Scalar>(&self, ray: &Ray) -> CubeRay<T> {
        let CubeRay { constant, slope, denominator, nearest } =
            self.transformed::<f64>(ray.origin.coords.into(), ray.direction.into());
        CubeRay {
            constant: constant.map(T::from_f64),
            slope: slope.map(T::from_f64),
            denominator: denominator.map(T::from_f64),
            nearest: T::from_f64(nearest),
        }
    }

    /// The ray through `origin` of direction `direction` (world) in cube coordinates.
    pub(crate) fn transformed<T: Real>(&self, origin: [T; 3], direction: [T; 3]) -> CubeRay<T> {
        let n = T::from_f64;
        let turned = |v: [T; 3]| -> [T; 3] {
            std::array::from_fn(|r| (0..3).map(|c| n(self.rotation[r][c]) * v[c]).sum())
        };
        let origin = turned(origin);
        let o: [T; 3] = std::array::from_fn(|r| origin[r] + n(self.translation[r]));
        let d = turned(direction);
        // u = scale x/z + offset; s = (1/z - 1/far) / (1/near - 1/far), over the common denominator g = z / depth.
        let range = 1.0 / (1.0 / self.near - 1.0 / self.far);
        let image = |p: [T; 3], axis: usize| n(self.scale[axis]) * p[axis] + n(self.offset[axis]) * p[2];
        CubeRay {
            constant: [image(d, 0), image(d, 1), n(-range / self.far) * d[2]],
            slope: [image(o, 0), image(o, 1), n(range) * (T::ONE - o[2] / n(self.far))],
            denominator: [d[2], o[2]],
            nearest: n(0.1 * self.near),
        }
    }

    /// Disparity scaled to 0 at far and 1 at near.
    pub(crate) fn disparity(&self, z: f64) -> f64 {
        (1.0 / z - 1.0 / self.far) / (1.0 / self.near - 1.0 / self.far)
    }

    /// \\(|\mathrm d r / \mathrm d z|\\) of that disparity \\(r\\).
    pub(crate) fn disparity_slope(&self, z: f64) -> f64 {
        1.0 / (z * z * (1.0 / self.near - 1.0 / self.far))
    }

    /// The depth at a fraction `x` of the range from near to far, in disparity.
    #[cfg(test)]
    pub(crate) fn depth_at(&self, x: f64) -> f64 {
        1.0 / ((1.0 - x) / self.near + x / self.far)
    }

    /// The fraction of the range at a depth, clamped to 0 and 1.
    pub(crate) fn fraction_at(&self, z: f64) -> f64 {
        (1.0 - self.disparity(z)).clamp(0.0, 1.0)
    }
}

/// Near, far and the median depth of a view's hypotheses.
fn depth_range(view: &PosedView, sampling: &SamplingConfig) -> Result<(f64, f64, f64)> {
    let mut depths: Vec<f32> = view
        .hypotheses
        .iter()
        .flat_map(|h| h.mean().into_iter().copied().zip(h.variance().into_iter().copied()))
        .filter(|&(mean, variance)| variance.is_finite() && mean > 0.0)
        .map(|(mean, _)| mean)
        .collect();
    depths.sort_unstable_by(f32::total_cmp);
    let quantile = |q: f64| nearest_rank_sorted(&depths, q).map(f64::from);
    let near = sampling.near.or_else(|| Some(STRETCH[0] * quantile(QUANTILES[0])?)).ok_or(Error::NoRange)?;
    let far = sampling.far.or_else(|| Some(STRETCH[1] * quantile(QUANTILES[1])?)).ok_or(Error::NoRange)?;
    if !(near > 0.0 && far > near * 1.0001) {
        return Err(Error::Config {
            field: "sampling.near, sampling.far",
            value: format!("{near}, {far}"),
            remedy: "give a positive near below far, or a depth hypothesis that spans a range",
        });
    }
    Ok((near, far, quantile(0.5).unwrap_or(0.5 * (near + far))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::GaussianDepth;
    use ndarray::{Array2, Array3};
    use proptest::prelude::*;

    fn view(pose: Pose, near: f32, far: f32) -> PosedView {
        let camera = PinholeCamera::from_fov(70.0, 16, 12).unwrap();
        let depth =
            Array2::from_shape_fn((12, 16), |(y, x)| near + (far - near) * (y * 16 + x) as f32 / 191.0);
        let hypothesis = GaussianDepth::new(depth, Array2::zeros((12, 16))).unwrap();
        let mask = Array2::from_elem((12, 16), true);
        PosedView::new(Array3::zeros((12, 16, 3)), camera, pose, mask, vec![hypothesis]).unwrap()
    }

    fn pose() -> impl Strategy<Value = Pose> {
        mde_warp::proptest::pose(0.05, 3.0)
    }

    proptest! {
        /// The frusta of all views between near and far lie inside the cube: no coordinate is clamped.
        #[test]
        fn the_cube_contains_the_frusta_of_all_views(
            original in pose(), other in pose(), x in -0.5..15.5_f64, y in -0.5..11.5_f64, s in 0.0..1.0_f64
        ) {
            let views = [view(original, 1.0, 5.0), view(other * original, 1.0, 5.0)];
            let frustum = Frustum::of_views(&views, &SamplingConfig::default()).unwrap();
            for view in &views {
                let ray = Ray::new(&view.camera, &view.pose, x, y);
                let z = frustum.depth_at(s);
                let point = ray.origin + z * ray.direction;
                let q: [f64; 3] = frustum.cube_ray(&ray).cube(1.0 / z);
                let p = original * point;
                prop_assert!((q[0] - (frustum.scale[0] * p.x / p.z + frustum.offset[0])).abs() < 1e-9, "u is clamped: {:?}", q);
                prop_assert!((q[1] - (frustum.scale[1] * p.y / p.z + frustum.offset[1])).abs() < 1e-9, "v is clamped: {:?}", q);
            }
        }

        #[test]
        fn depth_and_fraction_are_inverse_and_run_from_near_to_far(x in 0.0..=1.0_f64, near in 0.1..2.0_f32, range in 1.1..20.0_f32) {
            let frustum = Frustum::of_views(&[view(Pose::identity(), near, near * range)], &SamplingConfig::default()).unwrap();
            prop_assert!((frustum.fraction_at(frustum.depth_at(x)) - x).abs() < 1e-9);
            prop_assert!((frustum.depth_at(0.0) - frustum.near).abs() < 1e-9 * frustum.near);
            prop_assert!((frustum.depth_at(1.0) - frustum.far).abs() < 1e-9 * frustum.far);
            prop_assert!(frustum.near < f64::from(near) && frustum.far > f64::from(near * range));
        }
    }
}
