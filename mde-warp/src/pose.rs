use crate::{Error, PinholeCamera, Result};
use nalgebra::Isometry3;

/// World to camera. The world is the original camera's frame, in the prior's unit.
pub type Pose = Isometry3<f64>;

/// A pose's matrix, row by row.
pub fn matrix_rows(pose: &Pose) -> [[f64; 4]; 4] {
    pose.to_homogeneous().transpose().into()
}

pub(crate) fn check_pose(which: &'static str, pose: &Pose) -> Result<()> {
    let finite = pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite());
    if finite { Ok(()) } else { Err(Error::Pose { which }) }
}

/// Checks two cameras with their poses.
pub(crate) fn check_cameras(source: (&PinholeCamera, &Pose), target: (&PinholeCamera, &Pose)) -> Result<()> {
    source.0.validate()?;
    target.0.validate()?;
    check_pose("source", source.1)?;
    check_pose("target", target.1)
}
