//! Pixels of one camera in another, by their depth.
//!
//! [`Transfer`] goes through rays and gives the change of depth along them, which a mesh and its variances need;
//! [`PlaneTransfer`] multiplies the camera matrices once, which a plane sweep needs. They agree to rounding.

use crate::pose::check_pose;
use crate::{PinholeCamera, Pose, PosedView, Result};
use nalgebra::{Matrix3, Point2, Vector3};

/// A point nearer to the target's plane than this share of its source depth counts as behind it.
const NEAR: f64 = 1e-6;

/// Pixels and depths of a source camera carried into a target camera:
/// \\( X' = z R d(u, v) + t \\) with \\( d \\) the source ray of z = 1.
#[derive(Debug, Clone, Copy)]
pub struct Transfer {
    pub(crate) source: PinholeCamera,
    pub(crate) target: PinholeCamera,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

/// A source point in the target: pixel, inverse depth (0 where it is not in front), and source depth over target depth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Projected {
    /// Column, pixels.
    pub x: f64,
    /// Row, pixels.
    pub y: f64,
    /// Inverse z-depth in the target.
    pub inverse_depth: f64,
    /// Source depth over target depth.
    pub ratio: f64,
}

impl Transfer {
    /// From one camera with its pose to another.
    ///
    /// # Errors
    /// [`Error::Camera`](crate::Error::Camera) or [`Error::Pose`](crate::Error::Pose) for the first camera or pose at fault.
    pub fn new(source: (&PinholeCamera, &Pose), target: (&PinholeCamera, &Pose)) -> Result<Self> {
        source.0.validate()?;
        target.0.validate()?;
        check_pose("source", source.1)?;
        check_pose("target", target.1)?;
        let motion = target.1 * source.1.inverse();
        let rotation = motion.rotation.to_rotation_matrix().into_inner();
        Ok(Self { source: *source.0, target: *target.0, rotation, translation: motion.translation.vector })
    }

    /// The transfer from the target to the source.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        let translation = -(rotation * self.translation);
        Self { source: self.target, target: self.source, rotation, translation }
    }

    /// Projection of a source pixel (column `u`, row `v`) at an inverse z-depth >= 0 into the target.
    pub fn project(&self, u: f64, v: f64, disparity: f64) -> Projected {
        // Everything over the source depth, so that a point at infinity works too.
        let p = self.rotation * self.source.ray(Point2::new(u, v)) + self.translation * disparity;
        if p.z.is_nan() || p.z <= NEAR {
            return Projected::default();
        }
        let ratio = p.z.recip();
        let projected = Projected {
            x: self.target.fx * (p.x * ratio) + self.target.cx,
            y: self.target.fy * (p.y * ratio) + self.target.cy,
            inverse_depth: disparity * ratio,
            ratio,
        };
        let finite = [projected.x, projected.y, projected.inverse_depth].iter().all(|x| x.is_finite());
        if finite { projected } else { Projected::default() }
    }

    /// \\( \partial z' / \partial z = e_z^\top R d(u, v) \\): constant along a source ray.
    pub fn gain(&self, u: f64, v: f64) -> f64 {
        (self.rotation * self.source.ray(Point2::new(u, v))).z
    }
}

/// Pixels of a source view carried into a target view by their inverse depth.
///
/// With \\( K \\) the camera matrices and \\( w = 1/z \\),
/// \\( p = K_t R K_s^{-1} (u, v, 1)^\top + w K_t t \\); the target pixel is \\( p_{xy} / p_z \\) and the target's inverse
/// depth \\( w / p_z \\).
#[derive(Debug, Clone, Copy)]
pub struct PlaneTransfer {
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

impl PlaneTransfer {
    /// From one view to another; both as [`PosedView::validate`] accepts them.
    pub fn new(source: &PosedView, target: &PosedView) -> Self {
        let motion = target.pose * source.pose.inverse();
        let (s, t) = (&source.camera, &target.camera);
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
