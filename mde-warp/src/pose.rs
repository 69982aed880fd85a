use crate::raster::Sample;
use crate::{Error, PinholeCamera, Result};
use nalgebra::{Isometry3, Matrix3, Point2, Vector2, Vector3};

/// World to camera. The world is the original camera's frame, in the prior's unit.
pub type Pose = Isometry3<f64>;

/// A point nearer to the target's plane than this share of its source depth is as good as behind it.
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

/// A source point seen by the target: pixel, inverse depth there (0 where it can't be seen), and the source depth over
/// the target depth.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) inverse_depth: f64,
    pub(crate) ratio: f64,
}

impl Transfer {
    /// # Errors
    /// What is wrong with either camera or pose.
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

    /// The same between the two cameras the other way round.
    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            source: self.target,
            target: self.source,
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// A source pixel (column `u`, row `v`) at an inverse z-depth >= 0, as the target sees it.
    pub(crate) fn see(&self, u: f64, v: f64, disparity: f64) -> Seen {
        // Everything over the source depth, so that a point at infinity works too.
        let p = self.rotation * self.source.ray(Point2::new(u, v)) + self.translation * disparity;
        if p.z.is_nan() || p.z <= NEAR {
            return Seen::default();
        }
        let ratio = p.z.recip();
        let seen = Seen {
            x: self.target.fx * (p.x * ratio) + self.target.cx,
            y: self.target.fy * (p.y * ratio) + self.target.cy,
            inverse_depth: disparity * ratio,
            ratio,
        };
        if seen.x.is_finite() && seen.y.is_finite() && seen.inverse_depth.is_finite() {
            seen
        } else {
            Seen::default()
        }
    }

    /// \\( \partial z' / \partial z = e_z^\top R d(u, v) \\): constant along a source ray.
    pub(crate) fn gain(&self, u: f64, v: f64) -> f64 {
        (self.rotation * self.source.ray(Point2::new(u, v))).z
    }

    /// \\( \partial (u', v') / \partial z \\) of a sample along its source ray, target pixels per unit of source depth.
    pub(crate) fn drift(&self, sample: &Sample) -> Vector2<f64> {
        let d = self.rotation * self.source.ray(Point2::new(sample.u, sample.v));
        let there = self.target.ray(Point2::new(sample.column as f64, sample.row as f64));
        let across = (d - there * d.z) * sample.inverse_depth;
        Vector2::new(self.target.fx * across.x, self.target.fy * across.y)
    }
}
