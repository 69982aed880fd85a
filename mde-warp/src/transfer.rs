//! Pixels of one camera in another, by their inverse depth.

use crate::{PinholeCamera, Pose, PosedView};
use nalgebra::{Matrix3, Vector3};

/// A point nearer to the target's plane than this share of its source depth counts as behind it.
const NEAR: f64 = 1e-6;

/// Pixels of a source view carried into a target view by their inverse depth.
///
/// With \\( K \\) the camera matrices and \\( w = 1/z \\),
/// \\( p = K_t R K_s^{-1} (u, v, 1)^\top + w K_t t \\); the target pixel is \\( p_{xy} / p_z \\) and the target's inverse
/// depth \\( w / p_z \\).
#[derive(Debug, Clone, Copy)]
pub struct Transfer {
    /// \\( K_t R K_s^{-1} \\).
    pub rotation: Matrix3<f64>,
    /// \\( K_t t \\).
    pub translation: Vector3<f64>,
    width: usize,
    height: usize,
}

/// A source pixel in the target view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Column, pixels.
    pub x: f64,
    /// Row, pixels.
    pub y: f64,
    /// Target depth over source depth.
    pub ratio: f64,
}

impl Transfer {
    /// From one view to another; both as [`PosedView::validate`] accepts them.
    pub fn new(source: &PosedView, target: &PosedView) -> Self {
        Self::between((&source.camera, &source.pose), (&target.camera, &target.pose))
    }

    /// From one camera with its pose to another.
    pub fn between((s, from): (&PinholeCamera, &Pose), (t, to): (&PinholeCamera, &Pose)) -> Self {
        let motion = to * from.inverse();
        let inverse =
            Matrix3::new(1.0 / s.fx, 0.0, -s.cx / s.fx, 0.0, 1.0 / s.fy, -s.cy / s.fy, 0.0, 0.0, 1.0);
        let matrix = Matrix3::new(t.fx, 0.0, t.cx, 0.0, t.fy, t.cy, 0.0, 0.0, 1.0);
        Self {
            rotation: matrix * motion.rotation.to_rotation_matrix().into_inner() * inverse,
            translation: matrix * motion.translation.vector,
            width: t.width,
            height: t.height,
        }
    }

    /// `(height, width)` of the target.
    pub(crate) fn dim(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// \\( \partial z' / \partial z = p_z \\) at \\( w = 0 \\): constant along a source ray.
    pub(crate) fn gain(&self, u: f64, v: f64) -> f64 {
        (self.rotation * Vector3::new(u, v, 1.0)).z
    }

    /// Where column `u`, row `v` at inverse depth `w` >= 0 lands; nothing behind the target.
    #[inline]
    pub fn at(&self, u: f64, v: f64, w: f64) -> Option<Seen> {
        let p = self.rotation * Vector3::new(u, v, 1.0) + self.translation * w;
        if p.z.is_nan() || p.z <= NEAR {
            return None;
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        (x.is_finite() && y.is_finite()).then_some(Seen { x, y, ratio: p.z })
    }

    /// The nearest target pixel `(row, column)`, where it lies on the image.
    #[inline]
    pub fn nearest(&self, seen: &Seen) -> Option<(usize, usize)> {
        // Without the call that rounding is on old processors.
        let (x, y) = (seen.x + 0.5, seen.y + 0.5);
        let inside = x > 0.0 && y > 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then_some((y as usize, x as usize))
    }
}
