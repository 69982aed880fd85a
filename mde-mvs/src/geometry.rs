use mde_warp::{PinholeCamera, PosedView};
use nalgebra::{Matrix3, Vector3};

/// A pixel nearer to the target's plane than this share of its source depth counts as behind it.
const NEAR: f64 = 1e-6;

/// Pixels of a source view carried into a target view by their inverse depth.
///
/// With \\( K \\) the camera matrices and \\( w = 1/z \\),
/// \\( p = K_t R K_s^{-1} (u, v, 1)^\top + w K_t t \\); the target pixel is \\( p_{xy} / p_z \\) and the target's inverse
/// depth \\( w / p_z \\).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transfer {
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

/// A source pixel in the target view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seen {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Target depth over source depth.
    pub(crate) ratio: f64,
}

fn matrix(camera: &PinholeCamera) -> Matrix3<f64> {
    Matrix3::new(camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
}

fn inverse_matrix(c: &PinholeCamera) -> Matrix3<f64> {
    Matrix3::new(1.0 / c.fx, 0.0, -c.cx / c.fx, 0.0, 1.0 / c.fy, -c.cy / c.fy, 0.0, 0.0, 1.0)
}

impl Transfer {
    pub(crate) fn new(source: &PosedView, target: &PosedView) -> Self {
        let motion = target.pose * source.pose.inverse();
        let k = matrix(&target.camera);
        Self {
            rotation: k * motion.rotation.to_rotation_matrix().into_inner() * inverse_matrix(&source.camera),
            translation: k * motion.translation.vector,
            width: target.camera.width,
            height: target.camera.height,
        }
    }

    /// Where column `u`, row `v` at inverse depth `w` >= 0 lands; nothing behind the target.
    pub(crate) fn at(&self, u: f64, v: f64, w: f64) -> Option<Seen> {
        let p = self.rotation * Vector3::new(u, v, 1.0) + self.translation * w;
        if p.z.is_nan() || p.z <= NEAR {
            return None;
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        (x.is_finite() && y.is_finite()).then_some(Seen { x, y, ratio: p.z })
    }

    /// The nearest target pixel `(row, column)`, where it lies on the image.
    pub(crate) fn nearest(&self, seen: &Seen) -> Option<(usize, usize)> {
        let (x, y) = (seen.x.round(), seen.y.round());
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        inside.then_some((y as usize, x as usize))
    }
}

/// Distance between two optical centres.
pub(crate) fn baseline(a: &PosedView, b: &PosedView) -> f64 {
    let centre = |view: &PosedView| view.pose.inverse().translation.vector;
    (centre(a) - centre(b)).norm()
}
