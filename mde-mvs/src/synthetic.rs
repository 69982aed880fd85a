//! Analytic renderings of textured planes, for tests.

use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Point2, Point3, Translation3, UnitQuaternion, Vector3};
use ndarray::{Array2, Array3};

/// The plane of points with `normal . x = offset`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) normal: Vector3<f64>,
    pub(crate) offset: f64,
}

impl Plane {
    /// z = depth + a x + b y.
    pub(crate) fn slanted(depth: f64, a: f64, b: f64) -> Self {
        Self { normal: Vector3::new(-a, -b, 1.0), offset: depth }
    }
}

fn hash(x: i64, y: i64, z: i64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ (z as u64).wrapping_mul(0x1656_67B1_9E37_79F9);
    h ^= h >> 29;
    h = h.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h ^= h >> 32;
    (h >> 11) as f64 / (1_u64 << 53) as f64
}

/// Value noise of unit period with smooth interpolation, in [0, 1].
fn noise(p: Vector3<f64>) -> f64 {
    let (x, y, z) = (p.x.floor(), p.y.floor(), p.z.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (fx, fy, fz) = (ease(p.x - x), ease(p.y - y), ease(p.z - z));
    let mut sum = 0.0;
    for (i, wx) in [(0, 1.0 - fx), (1, fx)] {
        for (j, wy) in [(0, 1.0 - fy), (1, fy)] {
            for (k, wz) in [(0, 1.0 - fz), (1, fz)] {
                sum += wx * wy * wz * hash(x as i64 + i, y as i64 + j, z as i64 + k);
            }
        }
    }
    sum
}

/// A colour in [0, 1] at a point of the world.
fn texture(p: Point3<f64>, period: f64) -> [f32; 3] {
    std::array::from_fn(|c| {
        let shift = Vector3::repeat(17.3 * (c as f64 + 1.0));
        let at = p.coords / period + shift;
        (0.1 + 0.8 * (0.6 * noise(at) + 0.4 * noise(at * 2.7))) as f32
    })
}

/// A view of planes (the nearest in front wins) and its true z-depth.
pub(crate) fn render(
    planes: &[Plane],
    camera: PinholeCamera,
    pose: Pose,
    period: f64,
) -> (PosedView, Array2<f32>) {
    let (h, w) = camera.dim();
    let back = pose.inverse();
    let centre = back.translation.vector;
    let mut depth = Array2::zeros((h, w));
    let mut image = Array3::zeros((h, w, 3));
    for ((y, x), z) in depth.indexed_iter_mut() {
        let ray = back.rotation * camera.ray(Point2::new(x as f64, y as f64));
        let hits = planes.iter().map(|p| (p.offset - p.normal.dot(&centre)) / p.normal.dot(&ray));
        let hit = hits.filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
        *z = hit as f32;
        for (c, value) in texture(Point3::from(centre + ray * hit), period).into_iter().enumerate() {
            image[(y, x, c)] = value;
        }
    }
    let mask = Array2::from_elem((h, w), true);
    (PosedView::new(image, camera, pose, mask, Vec::new()).unwrap(), depth)
}

/// A camera at `centre`, turned by `angles` radians about x, y and z.
pub(crate) fn pose_at(centre: [f64; 3], angles: [f64; 3]) -> Pose {
    let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
    Pose::from_parts(Translation3::from(-(rotation * Vector3::from(centre))), rotation)
}

/// `centres.len()` views of planes, the texture of about six pixels' period, with true depths.
pub(crate) fn scene(
    planes: &[Plane],
    size: (usize, usize),
    centres: &[[f64; 3]],
) -> (Vec<PosedView>, Vec<Array2<f32>>) {
    let camera = PinholeCamera::from_fov(60.0, size.1, size.0).unwrap();
    let near = planes.iter().map(|p| p.offset / p.normal.norm()).fold(f64::INFINITY, f64::min);
    let period = 6.0 * near / camera.fx;
    centres.iter().map(|&c| render(planes, camera, pose_at(c, [0.0; 3]), period)).unzip()
}

const CENTRES: [[f64; 3]; 4] = [[0.0; 3], [0.25, 0.0, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.2, 0.1]];

/// Two slanted walls that meet, and priors of them in a unit of their own, with a smooth error of 20 %.
pub(crate) fn room(unit: f32) -> (Vec<PosedView>, Vec<Array2<f32>>, Vec<Array2<f32>>) {
    let planes = [Plane::slanted(2.0, 0.5, 0.1), Plane::slanted(2.1, -0.6, 0.0)];
    let (views, depths) = scene(&planes, (72, 96), &CENTRES);
    let bend = |x: usize| 1.0 + 0.2 * (x as f32 / 15.0).sin();
    let wave = Array2::from_shape_fn((72, 96), |(y, x)| unit * bend(x + y / 2));
    let priors = depths.iter().map(|depth| &wave * depth).collect();
    (views, depths, priors)
}
