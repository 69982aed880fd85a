use crate::{Error, PinholeCamera, Result};
use nalgebra::{Isometry3, Matrix3, Point2, Vector3};

/// World to camera. The world is the original camera's frame, in the prior's unit.
pub type Pose = Isometry3<f64>;

/// A point nearer to the target's plane than this share of its source depth counts as behind it.
const NEAR: f64 = 1e-6;

pub(crate) fn check_pose(which: &'static str, pose: &Pose) -> Result<()> {
    let finite = pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite());
    if finite { Ok(()) } else { Err(Error::Pose { which }) }
}

/// Pixels and depths of a source camera carried into a target camera:
/// \\( X' = z R d(u, v) + t \\) with \\( d \\) the source ray of z = 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transfer {
    pub(crate) source: PinholeCamera,
    pub(crate) target: PinholeCamera,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

/// A source point in the target: pixel, inverse depth (0 where it is not in front), and source depth over target depth.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Projected {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) inverse_depth: f64,
    pub(crate) ratio: f64,
}

impl Transfer {
    /// # Errors
    /// [`Error::Camera`] or [`Error::Pose`] for the first camera or pose at fault.
    pub(crate) fn new(source: (&PinholeCamera, &Pose), target: (&PinholeCamera, &Pose)) -> Result<Self> {
        source.0.validate()?;
        target.0.validate()?;
        check_pose("source", source.1)?;
        check_pose("target", target.1)?;
        let motion = target.1 * source.1.inverse();
        let (rotation, translation) =
            (motion.rotation.to_rotation_matrix().into_inner(), motion.translation.vector);
        Ok(Self { source: *source.0, target: *target.0, rotation, translation })
    }

    /// The transfer from the target to the source.
    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            source: self.target,
            target: self.source,
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// Projection of a source pixel (column `u`, row `v`) at an inverse z-depth >= 0 into the target.
    pub(crate) fn project(&self, u: f64, v: f64, disparity: f64) -> Projected {
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
        if projected.x.is_finite() && projected.y.is_finite() && projected.inverse_depth.is_finite() {
            projected
        } else {
            Projected::default()
        }
    }

    /// \\( \partial z' / \partial z = e_z^\top R d(u, v) \\): constant along a source ray.
    pub(crate) fn gain(&self, u: f64, v: f64) -> f64 {
        (self.rotation * self.source.ray(Point2::new(u, v))).z
    }
}
