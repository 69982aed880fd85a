//! What a room is made of besides its furniture: lights and the camera.

use crate::scene::render::{Eye, Light};
use crate::scene::shape::Vector;
use crate::scene::stage::Stage;
use crate::scene::texture::Colour;

/// A furnished room with its lights and camera.
pub(in crate::scene) struct Setting {
    pub(in crate::scene) stage: Stage,
    pub(in crate::scene) lights: Vec<Light>,
    pub(in crate::scene) ambient: Colour,
    pub(in crate::scene) eye: Eye,
    /// Horizontal, in degrees.
    pub(in crate::scene) field_of_view: f64,
}

pub(super) fn light(position: [f64; 3], radius: f64, power: f64, colour: [f64; 3]) -> Light {
    Light { position: position.into(), radius, colour: Colour::from(colour) * power }
}

pub(super) const WARM: [f64; 3] = [1.0, 0.82, 0.62];
pub(super) const DAY: [f64; 3] = [0.86, 0.94, 1.0];

/// Eye height and direction with a seeded hand-held wobble.
pub(super) fn eye(stage: &mut Stage, at: [f64; 3], yaw: f64, pitch: f64) -> Eye {
    let wobble =
        Vector::new(stage.between(-0.12, 0.12), stage.between(-0.08, 0.08), stage.between(-0.06, 0.06));
    let (yaw, pitch) = (yaw + stage.between(-3.0, 3.0), pitch + stage.between(-1.5, 1.5));
    Eye::new(Vector::from(at) + wobble, yaw, pitch)
}
