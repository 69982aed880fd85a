//! The rooms: what stands where.

mod bedroom;
mod corridor;
mod kitchen;
mod living;
mod office;
mod study;
mod workshop;

use super::Room;
use super::furniture::*;
use super::render::{Eye, Light};
use super::solid::{Body, Vector};
use super::stage::{Stage, Stand, enamel, lean, metal, oak, walnut, wood};
use super::texture::{Colour, Material, Texture, rgb};

pub(super) fn furnish(room: Room, seed: u64) -> (Vec<Body>, Setting) {
    let mut stage = Stage::new(seed, &room.to_string());
    let furnish = match room {
        Room::Study => study::furnish,
        Room::LivingRoom => living::furnish,
        Room::Kitchen => kitchen::furnish,
        Room::Corridor => corridor::furnish,
        Room::Workshop => workshop::furnish,
        Room::Office => office::furnish,
        Room::Bedroom => bedroom::furnish,
    };
    let setting = furnish(&mut stage);
    (stage.bodies, setting)
}

/// The lights and the camera of a room.
#[derive(Debug, Clone)]
pub(super) struct Setting {
    pub(super) lights: Vec<Light>,
    pub(super) ambient: Colour,
    pub(super) eye: Eye,
    /// Horizontal, in degrees.
    pub(super) field_of_view: f64,
}

fn light(position: [f64; 3], radius: f64, power: f64, colour: [f64; 3]) -> Light {
    Light { position: position.into(), radius, colour: Colour::from(colour) * power }
}

const WARM: [f64; 3] = [1.0, 0.82, 0.62];
const DAY: [f64; 3] = [0.86, 0.94, 1.0];

/// Eye height and direction with a seeded hand-held wobble.
fn eye(stage: &mut Stage, at: [f64; 3], yaw: f64, pitch: f64) -> Eye {
    let wobble =
        Vector::new(stage.between(-0.12, 0.12), stage.between(-0.08, 0.08), stage.between(-0.06, 0.06));
    let (yaw, pitch) = (yaw + stage.between(-3.0, 3.0), pitch + stage.between(-1.5, 1.5));
    Eye::new(Vector::from(at) + wobble, yaw, pitch)
}
