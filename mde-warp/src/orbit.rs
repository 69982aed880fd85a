use crate::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// So many poses evenly on a circle about the original camera, of `radius` times the `distance`, that all look at the point ahead of the
/// original camera at that distance; upright, the first to the right of it.
pub fn orbit(count: usize, radius: f64, distance: f64) -> Vec<Pose> {
    let pose = |k: usize| {
        let (sin, cos) = (TAU * (k as f64 / count as f64)).sin_cos();
        let centre = Vector3::new(cos, sin, 0.0) * (radius * distance);
        let ahead = Vector3::new(0.0, 0.0, distance) - centre;
        // y points down, so "up" of a right-handed frame with z ahead is y itself.
        let rotation = UnitQuaternion::look_at_rh(&-ahead, &Vector3::y());
        Pose::from_parts(Translation3::from(-(rotation * centre)), rotation)
    };
    (0..count).map(pose).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn the_orbit_looks_at_one_point_and_stays_upright() {
        for pose in orbit(8, 0.1, 3.0) {
            let target = pose * Point3::new(0.0, 0.0, 3.0);
            assert!(target.x.abs() < 1e-12 && target.y.abs() < 1e-12 && target.z > 3.0, "{target}");
            let centre = pose.inverse() * Point3::origin();
            assert!((centre.coords.norm() - 0.3).abs() < 1e-12);
            // The world's down stays down in the picture.
            assert!((pose.rotation * Vector3::y()).y > 0.9);
        }
    }
}
