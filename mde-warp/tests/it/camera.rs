//! Theorems of the pinhole camera.

use approx::assert_relative_eq;
use mde_warp::PinholeCamera;
use mde_warp::nalgebra::{Point2, Point3};
use mde_warp::proptest::pinhole;
use proptest::prelude::*;

proptest! {
    #[test]
    fn project_and_unproject_are_inverse(
        camera in pinhole(64),
        u in -100.0..200.0_f64,
        v in -100.0..200.0_f64,
        depth in 1e-3..1e3_f64,
    ) {
        let point = camera.unproject(Point2::new(u, v), depth);
        prop_assert!((point.z - depth).abs() <= 1e-15 * depth);
        let pixel = camera.project(&point).unwrap();
        assert_relative_eq!(pixel, Point2::new(u, v), epsilon = 1e-9);
        assert_relative_eq!(camera.unproject(pixel, point.z), point, max_relative = 1e-9, epsilon = 1e-9);
    }

    #[test]
    fn nothing_behind_the_camera_is_seen(camera in pinhole(8), x in -9.0..9.0_f64, y in -9.0..9.0_f64, z in -9.0..=0.0_f64) {
        prop_assert_eq!(camera.project(&Point3::new(x, y, z)), None);
    }

    /// A resized camera sends the same ray to the same place of the picture, measured from its edge.
    #[test]
    fn resizing_keeps_rays(camera in pinhole(64), width in 1..200_usize, height in 1..200_usize, s in 0.0..1.0_f64, t in 0.0..1.0_f64) {
        let resized = camera.resized(width, height).unwrap();
        let at = |c: &PinholeCamera| c.ray(Point2::new(s * c.width as f64 - 0.5, t * c.height as f64 - 0.5));
        assert_relative_eq!(at(&camera), at(&resized), epsilon = 1e-9);
        let again = resized.resized(camera.width, camera.height).unwrap();
        assert_relative_eq!(again.fx, camera.fx, max_relative = 1e-12);
        assert_relative_eq!(again.cy, camera.cy, epsilon = 1e-9);
    }
}
