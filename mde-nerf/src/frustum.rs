//! The modelled volume: the original camera's frustum between near and far, mapped to the unit cube.

use crate::config::{SamplingConfig, VolumeConfig};
use crate::scalar::Scalar;
use crate::{Error, Result};
use mde_uncertainty::statistics::nearest_rank_sorted;
use mde_uncertainty::{OutOfRange, Real};
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Quantiles of the hypotheses' depths, and the factors from them to near and far.
const QUANTILES: [f64; 2] = [0.005, 0.995];
const STRETCH_HULL: [f64; 2] = [0.8, 1.25];
const STRETCH_REFERENCE: [f64; 2] = [0.75, 1.3];
/// Margin of [`VolumeConfig::Reference`] on each side, as a fraction of the image's width and height.
const MARGIN: f64 = 0.06;
/// Lower end of clipped rays whose camera is inside the volume, as a fraction of near.
const NEAREST: f64 = 0.1;

/// Maps the world to \\((u, v, s) \in [0, 1]^3\\): the original camera's pixel coordinates, with the margin that holds the
/// other views, and \\(s = (1/z - 1/far) / (1/near - 1/far)\\).
///
/// The map is projective: rays stay straight, cells match pixels, and no cell lies outside all views.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Whether rays are clipped to the volume.
    pub(crate) clipped: bool,
}

/// The sampled part of a ray, by z-depth in its camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub(crate) near: f64,
    pub(crate) far: f64,
    /// Unit of disparities, the same for all rays: \\(1/near - 1/far\\) of the volume.
    unit: f64,
}

impl Interval {
    /// \\(1/near - 1/far\\) of the ray.
    pub(crate) fn width(&self) -> f64 {
        1.0 / self.near - 1.0 / self.far
    }

    /// Disparity less that of the far end, in units of the volume's.
    pub(crate) fn disparity(&self, z: f64) -> f64 {
        (1.0 / z - 1.0 / self.far) / self.unit
    }

    /// That disparity at the near end; 1 for a ray that is not clipped.
    pub(crate) fn largest_disparity(&self) -> f64 {
        self.width() / self.unit
    }

    /// \\(|\mathrm d r / \mathrm d z|\\) of that disparity \\(r\\).
    pub(crate) fn disparity_slope(&self, z: f64) -> f64 {
        1.0 / (z * z * self.unit)
    }

    /// The fraction of the interval at a depth, in disparity, clamped to 0 and 1.
    pub(crate) fn fraction_at(&self, z: f64) -> f64 {
        (1.0 - (1.0 / z - 1.0 / self.far) / self.width()).clamp(0.0, 1.0)
    }

    pub(crate) fn contains(&self, z: f64) -> bool {
        (self.near..=self.far).contains(&z)
    }
}

/// A ray parametrised by z-depth in its camera: the point at depth z is `origin + z * direction`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: Point3<f64>,
    /// World direction with unit z in the camera.
    pub(crate) direction: Vector3<f64>,
}

/// A ray in cube coordinates: \\((u, v, s)\\) at inverse depth \\(\lambda\\) is \\((a + \lambda b) / g\\) with \\(g = g_0 + \lambda g_1\\).
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
    /// What is wrong with a volume that was read from a file.
    pub(crate) fn fault(&self) -> Option<&'static str> {
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let rotation = nalgebra::Matrix3::from_fn(|r, c| self.rotation[r][c]);
        let turned = (rotation.transpose() * rotation - nalgebra::Matrix3::identity()).amax();
        let faults = [
            (!(turned < 1e-6 && rotation.determinant() > 0.0), "its rotation is none"),
            (!(finite(&self.translation) && finite(&self.offset)), "its translation or offset is not finite"),
            (!self.scale.iter().all(|s| *s > 0.0 && s.is_finite()), "its scale is not positive"),
            (
                !(self.near > 0.0 && self.near < self.far && self.far.is_finite()),
                "its near and far are no range of depths",
            ),
            (!(self.unit > 0.0 && self.unit.is_finite()), "its unit is not positive"),
        ];
        faults.into_iter().find_map(|(wrong, fault)| wrong.then_some(fault))
    }

    /// The volume of `views` that `sampling` describes.
    pub(crate) fn of_views(views: &[PosedView], sampling: &SamplingConfig) -> Result<Self> {
        let original = views.first().ok_or(Error::NoPixels)?;
        let (near, far, unit) = depth_range(original, sampling)?;
        let rotation = original.pose.rotation.to_rotation_matrix();
        let mut frustum = Self {
            rotation: rotation.matrix().transpose().into(),
            translation: original.pose.translation.vector.into(),
            scale: [1.0; 2],
            offset: [0.0; 2],
            near,
            far,
            unit,
            clipped: sampling.volume != VolumeConfig::Hull,
        };
        let (low, high) = match sampling.volume {
            VolumeConfig::Hull => hull(views, near, far),
            VolumeConfig::Reference => with_margin(&original.camera),
        };
        for axis in 0..2 {
            frustum.scale[axis] = 1.0 / (high[axis] - low[axis]).max(1e-9);
            frustum.offset[axis] = -low[axis] * frustum.scale[axis];
        }
        Ok(frustum)
    }

    /// The part of a ray that is sampled, from `nearest` on where rays are clipped; `None` where it misses the volume.
    pub(crate) fn interval(&self, ray: &Ray, nearest: f64) -> Option<Interval> {
        let unit = 1.0 / self.near - 1.0 / self.far;
        if !self.clipped {
            return Some(Interval { near: self.near, far: self.far, unit });
        }
        let (o, d) = self.in_original(ray);
        // The volume is near <= z <= far and 0 <= scale (x, y) + offset z <= z. At depth t of the ray's camera the point is
        // o + t d, so each bound is a + t b >= 0.
        let (mut low, mut high) = (nearest.max(NEAREST * self.near), f64::INFINITY);
        let mut bound = |a: f64, b: f64| {
            if b > 0.0 {
                low = low.max(-a / b);
            } else if b < 0.0 {
                high = high.min(-a / b);
            } else if a < 0.0 {
                high = f64::NEG_INFINITY;
            }
        };
        bound(o[2] - self.near, d[2]);
        bound(self.far - o[2], -d[2]);
        for axis in 0..2 {
            let side = |p: [f64; 3]| self.scale[axis] * p[axis] + self.offset[axis] * p[2];
            bound(side(o), side(d));
            bound(o[2] - side(o), d[2] - side(d));
        }
        // The least length that has distinct positions in `f32`.
        (high.is_finite() && high > low * (1.0 + 1e-5)).then_some(Interval { near: low, far: high, unit })
    }

    /// The lower end of a view's rays: 0.75 times the 0.5 % quantile of its hypotheses, 0 where it has none.
    pub(crate) fn nearest_of(view: &PosedView) -> f64 {
        nearest_rank_sorted(&known_depths(view), QUANTILES[0])
            .map_or(0.0, |z| STRETCH_REFERENCE[0] * f64::from(z))
    }

    /// Origin and direction of a ray in the original camera.
    fn in_original(&self, ray: &Ray) -> ([f64; 3], [f64; 3]) {
        let turned = |v: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|r| (0..3).map(|c| self.rotation[r][c] * v[c]).sum())
        };
        let origin = turned(ray.origin.coords.into());
        (std::array::from_fn(|r| origin[r] + self.translation[r]), turned(ray.direction.into()))
    }

    /// A ray in cube coordinates.
    pub(crate) fn cube_ray<T: Scalar>(&self, ray: &Ray) -> CubeRay<T> {
        let (o, d) = self.in_original(ray);
        // u = scale x/z + offset; s = (1/z - 1/far) / (1/near - 1/far), over the common denominator g = z / depth.
        let range = 1.0 / (1.0 / self.near - 1.0 / self.far);
        let image = |p: [f64; 3], axis: usize| self.scale[axis] * p[axis] + self.offset[axis] * p[2];
        CubeRay {
            constant: [image(d, 0), image(d, 1), -range / self.far * d[2]].map(T::from_f64),
            slope: [image(o, 0), image(o, 1), range * (1.0 - o[2] / self.far)].map(T::from_f64),
            denominator: [d[2], o[2]].map(T::from_f64),
            nearest: T::from_f64(0.1 * self.near),
        }
    }
}

/// The least and the largest x/z and y/z, in the original camera, of the frusta of all views between near and far.
fn hull(views: &[PosedView], near: f64, far: f64) -> ([f64; 2], [f64; 2]) {
    let original = views[0].pose;
    // The image of a convex hull is the hull of the corners' images while all of them lie in front.
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for view in views {
        let (right, bottom) = (view.camera.width as f64 - 0.5, view.camera.height as f64 - 0.5);
        for (x, y) in [(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)] {
            let ray = Ray::new(&view.camera, &view.pose, x, y);
            for z in [near, far] {
                let p = original * (ray.origin + z * ray.direction);
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
    (low, high)
}

/// The least and the largest x/z and y/z of a camera's image with a margin on each side.
fn with_margin(camera: &PinholeCamera) -> ([f64; 2], [f64; 2]) {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let low = camera.ray(Point2::new(-0.5 - MARGIN * width, -0.5 - MARGIN * height));
    let high = camera.ray(Point2::new((1.0 + MARGIN) * width - 0.5, (1.0 + MARGIN) * height - 0.5));
    ([low.x, low.y], [high.x, high.y])
}

/// Near, far and the median depth of a view's hypotheses.
fn depth_range(view: &PosedView, sampling: &SamplingConfig) -> Result<(f64, f64, f64)> {
    let depths = known_depths(view);
    let stretch = match sampling.volume {
        VolumeConfig::Hull => STRETCH_HULL,
        VolumeConfig::Reference => STRETCH_REFERENCE,
    };
    let quantile = |q: f64| nearest_rank_sorted(&depths, q).map(f64::from);
    let end = |side: usize| Some(stretch[side] * quantile(QUANTILES[side])?);
    let near = sampling.near.or_else(|| end(0)).ok_or(Error::NoRange)?;
    let far = sampling.far.or_else(|| end(1)).ok_or(Error::NoRange)?;
    let ends = format!("{near}, {far}");
    let remedy = "give a positive near below far, or a depth hypothesis that spans a range";
    OutOfRange::check(near > 0.0 && far > near * 1.0001, "sampling.near, sampling.far", &ends, remedy)?;
    Ok((near, far, quantile(0.5).unwrap_or(0.5 * (near + far))))
}

/// The known positive depths of all hypotheses of a view, sorted.
fn known_depths(view: &PosedView) -> Vec<f32> {
    let pixels = view.hypotheses.iter().flat_map(|h| h.mean().into_iter().zip(h.variance()));
    let known = pixels.filter(|(mean, variance)| variance.is_finite() && **mean > 0.0);
    let mut depths: Vec<f32> = known.map(|(mean, _)| *mean).collect();
    depths.sort_unstable_by(f32::total_cmp);
    depths
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::GaussianDepth;
    use mde_warp::proptest::pose;
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

    /// The depth at a fraction `x` of the interval, in disparity.
    fn depth_at(interval: Interval, x: f64) -> f64 {
        1.0 / ((1.0 - x) / interval.near + x / interval.far)
    }

    fn clipped() -> SamplingConfig {
        SamplingConfig { volume: VolumeConfig::Reference, ..SamplingConfig::default() }
    }

    proptest! {
        /// No coordinate of a sample is clamped: neither of a ray of any view in the hull, nor of any ray that is clipped itself, whose
        /// depth lies between near and far too.
        #[test]
        fn samples_are_inside_the_cube(
            original in pose(0.05, 3.0), other in pose(0.05, 3.0), far in pose(1.0, 60.0),
            x in -0.5..15.5_f64, y in -0.5..11.5_f64, s in 0.0..=1.0_f64,
        ) {
            let views = [view(original, 1.0, 5.0), view(other * original, 1.0, 5.0)];
            let hull = Frustum::of_views(&views, &SamplingConfig::default()).unwrap();
            let volume = Frustum::of_views(&views, &clipped()).unwrap();
            for (frustum, pose, axes) in
                [(&hull, original, 2), (&hull, other * original, 2), (&volume, far * original, 3)]
            {
                let ray = Ray::new(&views[0].camera, &pose, x, y);
                let Some(interval) = frustum.interval(&ray, 0.0) else { continue };
                let z = depth_at(interval, s);
                let p = original * (ray.origin + z * ray.direction);
                let [u, v] = [0, 1].map(|axis| frustum.scale[axis] * p[axis] / p.z + frustum.offset[axis]);
                let depth = (1.0 / p.z - 1.0 / frustum.far) / (1.0 / frustum.near - 1.0 / frustum.far);
                let cube: [f64; 3] = frustum.cube_ray(&ray).cube(1.0 / z);
                for (found, free) in cube.into_iter().zip([u, v, depth]).take(axes) {
                    prop_assert!((found - free).abs() < 1e-9, "{} is clamped to {}", free, found);
                }
            }
        }

        #[test]
        fn depth_and_fraction_are_inverse_and_run_from_near_to_far(x in 0.0..=1.0_f64, near in 0.1..2.0_f32, range in 1.1..20.0_f32) {
            let frustum = Frustum::of_views(&[view(Pose::identity(), near, near * range)], &SamplingConfig::default()).unwrap();
            let ray = Ray::new(&view(Pose::identity(), 1.0, 2.0).camera, &Pose::identity(), 3.0, 2.0);
            let interval = frustum.interval(&ray, 0.0).unwrap();
            prop_assert!((interval.fraction_at(depth_at(interval, x)) - x).abs() < 1e-9);
            prop_assert!((depth_at(interval, 0.0) - frustum.near).abs() < 1e-9 * frustum.near);
            prop_assert!((depth_at(interval, 1.0) - frustum.far).abs() < 1e-9 * frustum.far);
            prop_assert_eq!(interval.largest_disparity(), 1.0);
            prop_assert!(frustum.near < f64::from(near) && frustum.far > f64::from(near * range));
        }

        /// A point of any ray lies in the analytic interval exactly if its projection into the original camera lies in the
        /// image with its margin and its depth there between near and far.
        #[test]
        fn the_interval_of_a_clipped_ray_is_the_set_of_its_points_in_the_volume(
            original in pose(1.0, 180.0), other in pose(2.0, 120.0),
            x in -0.5..15.5_f64, y in -0.5..11.5_f64,
        ) {
            let reference = view(original, 1.0, 5.0);
            let frustum = Frustum::of_views(std::slice::from_ref(&reference), &clipped()).unwrap();
            let ray = Ray::new(&reference.camera, &(other * original), x, y);
            let interval = frustum.interval(&ray, 0.0);
            for i in 0..2000 {
                let z = 0.1 * frustum.near * 1.005_f64.powi(i);
                let p = original * (ray.origin + z * ray.direction);
                let pixel = reference.camera.project(&p);
                // Distances from the faces, positive inside; a point on a face may count either way.
                let [width, height] = [16.0, 12.0];
                let least = pixel.map_or(-1.0, |pixel| {
                    [
                        pixel.x + 0.5 + MARGIN * width,
                        (1.0 + MARGIN) * width - 0.5 - pixel.x,
                        pixel.y + 0.5 + MARGIN * height,
                        (1.0 + MARGIN) * height - 0.5 - pixel.y,
                        p.z - frustum.near,
                        frustum.far - p.z,
                    ]
                    .into_iter()
                    .fold(f64::INFINITY, f64::min)
                });
                let inside = interval.is_some_and(|interval| interval.contains(z));
                // A ray that only touches an edge of the volume has an interval too short to be sampled.
                let negligible = interval.is_none() && least < 1e-3;
                prop_assert!(inside == (least > 0.0) || least.abs() < 1e-6 || negligible, "z {}, {:?}, {}", z, interval, least);
            }
        }
    }
}
