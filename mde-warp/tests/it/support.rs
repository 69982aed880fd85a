//! Scenes with a known depth seen from anywhere.

use mde_uncertainty::GaussianDepth;
use mde_warp::nalgebra::{Point2, Point3};
use mde_warp::ndarray::{Array2, Array3};
use mde_warp::{PinholeCamera, Pose};
use proptest::prelude::*;

/// A pixel centre.
pub(crate) fn pixel(row: usize, column: usize) -> Point2<f64> {
    Point2::new(column as f64, row as f64)
}

/// The plane of inverse depth `a + b x + c y` in the source camera's normalised coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane(pub(crate) f64, pub(crate) f64, pub(crate) f64);

impl Plane {
    pub(crate) fn depth(&self, camera: &PinholeCamera, at: Point2<f64>) -> f64 {
        self.depth_from(camera, &Pose::identity(), at)
    }

    pub(crate) fn map(&self, camera: &PinholeCamera) -> Array2<f32> {
        Array2::from_shape_fn(camera.dim(), |(row, column)| self.depth(camera, pixel(row, column)) as f32)
    }

    /// z in a camera at `pose`, where the source is at the origin: the plane is n.X = 1 with n = (b, c, a).
    pub(crate) fn depth_from(&self, camera: &PinholeCamera, pose: &Pose, at: Point2<f64>) -> f64 {
        let back = pose.inverse();
        let (direction, centre) = (back.rotation * camera.ray(at), back.translation.vector);
        let along = |x: f64, y: f64, z: f64| self.1 * x + self.2 * y + self.0 * z;
        (1.0 - along(centre.x, centre.y, centre.z)) / along(direction.x, direction.y, direction.z)
    }
}

/// Planes whose depth stays near 1 to 4 within 100 degrees and whose slope never tears at 20 pixels or more.
pub(crate) fn plane() -> impl Strategy<Value = Plane> {
    (0.25..1.0_f64, -0.15..0.15_f64, -0.15..0.15_f64).prop_map(|(a, b, c)| Plane(a, a * b, a * c))
}

pub(crate) fn gaussian(mean: Array2<f32>, variance: f32) -> GaussianDepth {
    let variance = Array2::from_elem(mean.dim(), variance);
    GaussianDepth::new(mean, variance).unwrap()
}

/// Two levels: `near` in a rectangle, `far` about it; the rectangle is red, the rest blue.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TwoPlanes {
    pub(crate) near: f32,
    pub(crate) far: f32,
    pub(crate) rows: (usize, usize),
    pub(crate) columns: (usize, usize),
}

pub(crate) const RED: [f32; 3] = [1.0, 0.0, 0.0];
pub(crate) const BLUE: [f32; 3] = [0.0, 0.0, 1.0];

impl TwoPlanes {
    pub(crate) fn is_near(&self, row: usize, column: usize) -> bool {
        (self.rows.0..self.rows.1).contains(&row) && (self.columns.0..self.columns.1).contains(&column)
    }

    pub(crate) fn depth(&self, camera: &PinholeCamera) -> Array2<f32> {
        Array2::from_shape_fn(camera.dim(), |(r, c)| if self.is_near(r, c) { self.near } else { self.far })
    }

    pub(crate) fn image(&self, camera: &PinholeCamera) -> Array3<f32> {
        Array3::from_shape_fn((camera.height, camera.width, 3), |(r, c, channel)| {
            (if self.is_near(r, c) { RED } else { BLUE })[channel]
        })
    }

    /// Which of the two levels a depth at a target pixel is on: `Some(true)` for the near one.
    pub(crate) fn level(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        at: Point2<f64>,
        depth: f32,
    ) -> Option<bool> {
        let point: Point3<f64> = pose.inverse() * camera.unproject(at, depth.into());
        let on = |level: f32| (point.z / f64::from(level) - 1.0).abs() < 1e-5;
        if on(self.near) { Some(true) } else { on(self.far).then_some(false) }
    }
}

/// Two levels at least a quarter apart, the rectangle possibly one pixel thin.
pub(crate) fn two_planes(width: usize, height: usize) -> impl Strategy<Value = TwoPlanes> {
    let span = |size: usize| {
        (0..size, 1..=size).prop_map(move |(start, length)| (start, (start + length).min(size)))
    };
    (0.8..3.0_f32, 1.25..4.0_f32, span(height), span(width))
        .prop_map(|(near, ratio, rows, columns)| TwoPlanes { near, far: near * ratio, rows, columns })
}

pub(crate) fn image_of(height: usize, width: usize) -> impl Strategy<Value = Array3<f32>> {
    proptest::collection::vec(0.0..=1.0_f32, height * width * 3)
        .prop_map(move |colours| Array3::from_shape_vec((height, width, 3), colours).unwrap())
}
