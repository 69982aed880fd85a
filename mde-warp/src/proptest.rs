//! Strategies for property tests of code that takes these types.

use crate::{PinholeCamera, Pose};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

/// A camera of at most `max_side` pixels a side: 30 to 100 degrees wide, pixels up to 10 % from square, the principal
/// point within a tenth of the image of the middle.
pub fn pinhole(max_side: usize) -> impl Strategy<Value = PinholeCamera> {
    (1..=max_side.max(1), 1..=max_side.max(1)).prop_flat_map(|(width, height)| pinhole_of(width, height))
}

/// The same with a given width and height.
pub fn pinhole_of(width: usize, height: usize) -> impl Strategy<Value = PinholeCamera> {
    (30.0..100.0_f64, 0.9..1.1_f64, -0.1..0.1_f64, -0.1..0.1_f64).prop_map(move |(fov, aspect, dx, dy)| {
        let (w, h) = (width as f64, height as f64);
        let fx = 0.5 * w / (0.5 * fov.to_radians()).tan();
        let (cx, cy) = (0.5 * (w - 1.0) + dx * w, 0.5 * (h - 1.0) + dy * h);
        PinholeCamera { fx, fy: aspect * fx, cx, cy, width, height }
    })
}

/// A pose at most `translation` from the origin along each axis, turned by at most `degrees`.
pub fn pose(translation: f64, degrees: f64) -> impl Strategy<Value = Pose> {
    let unit =
        || (-1.0..=1.0_f64, -1.0..=1.0_f64, -1.0..=1.0_f64).prop_map(|(x, y, z)| Vector3::new(x, y, z));
    (unit(), unit()).prop_map(move |(centre, axis)| {
        // The vector's length, at most 1 after the division, sets the angle.
        let rotation = UnitQuaternion::from_scaled_axis(axis * (degrees.to_radians() / 3_f64.sqrt()));
        Pose::from_parts(Translation3::from(-(rotation * (centre * translation))), rotation)
    })
}
