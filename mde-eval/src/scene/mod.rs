//! Procedural rooms with exact depth.
//!
//! Furniture made of boxes, cones and ellipsoids is traced in closed form: the depth of a pixel is the z-depth where the ray
//! through its centre meets the first surface, in `f64`, never averaged, while the colour is supersampled, textured, lit and
//! shadowed. Chair legs, lamp poles, cords, glazing bars and shelf boards give the thin structures that monocular
//! priors lose. A [`Room`] and a seed fix everything; the seed moves furniture, camera and colours.

mod bvh;
mod furniture;
mod noise;
mod render;
mod rooms;
mod solid;
mod stage;
mod texture;
mod views;

pub use views::CaptureConfig;

use crate::Result;
use bvh::Hierarchy;
use mde_warp::{PinholeCamera, Pose};
use ndarray::{Array2, Array3};
use rooms::Setting;
use serde::Serialize;
use std::fmt;

/// The rooms there are, shown as `study`, `living-room` and so on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Room {
    /// A desk with a chair, a lamp on a thin pole, bookcase and wall shelves.
    Study,
    /// A sofa, coffee table, floor lamp, window with curtains.
    LivingRoom,
    /// Cupboards, a breakfast table with chairs and stools, hanging lamps.
    Kitchen,
    /// A long corridor with doors, radiator, bench and coat stand.
    Corridor,
    /// A bench under a board of tools, a ladder, planks on trestles, steel shelves with boxes.
    Workshop,
    /// Two desks with screens, swivel chairs, blinds and cabinets.
    Office,
    /// A bed with a barred headboard, wardrobe, bedside lamps.
    Bedroom,
}

impl Room {
    /// All rooms.
    pub const ALL: [Self; 7] = [
        Self::Study,
        Self::LivingRoom,
        Self::Kitchen,
        Self::Corridor,
        Self::Workshop,
        Self::Office,
        Self::Bedroom,
    ];
}

impl fmt::Display for Room {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// An image with its exact depth.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The image, `[height, width, 3]`, sRGB in 0 to 1.
    pub image: Array3<f32>,
    /// Exact z-depth at the pixels' centres in metres, `[height, width]`. The rooms are closed, so every depth is positive for a
    /// camera that stands in the open; what a camera outside the room does not see is 0.
    pub depth: Array2<f32>,
    /// The camera.
    pub camera: PinholeCamera,
}

/// A furnished room, rendered from its own camera or from any other pose.
#[derive(Debug, Clone)]
pub struct World {
    bodies: Hierarchy,
    setting: Setting,
    exposure: f64,
}

impl World {
    /// Furnishes a room. The same room and seed give the same world.
    ///
    /// # Errors
    /// None for the rooms there are; a camera fault would be passed on.
    pub fn new(room: Room, seed: u64) -> Result<Self> {
        let (bodies, setting) = rooms::furnish(room, seed);
        let mut world = Self { bodies: Hierarchy::new(bodies), setting, exposure: 1.0 };
        // Metered once, so that images from other poses match.
        world.exposure = world.metered(&world.camera(48, 36)?);
        Ok(world)
    }

    /// The room's own camera for an image of `width` by `height` pixels.
    ///
    /// # Errors
    /// [`Error::Camera`](crate::Error::Camera) for an empty image.
    pub fn camera(&self, width: usize, height: usize) -> Result<PinholeCamera> {
        Ok(PinholeCamera::from_fov(self.setting.field_of_view, width, height)?)
    }

    /// An image with its depth. The world is the frame of the room's own camera, whose pose (world to camera) is the identity.
    pub fn render(&self, camera: &PinholeCamera, pose: &Pose) -> Scene {
        let image = self.image(camera, &self.setting.eye.moved(pose));
        Scene { image, depth: self.depth(camera, pose), camera: *camera }
    }

    /// The exact z-depth alone, `[height, width]`, in metres: a tenth of the work of [`World::render`] or less.
    pub fn depth(&self, camera: &PinholeCamera, pose: &Pose) -> Array2<f32> {
        let eye = self.setting.eye.moved(pose);
        Array2::from_shape_fn(camera.dim(), |(y, x)| {
            let ray = eye.ray(camera, x as f64, y as f64);
            self.bodies.nearest(&ray, f64::INFINITY).map_or(0.0, |(_, contact)| contact.t as f32)
        })
    }
}

/// A room rendered from its own camera, `width` by `height` pixels.
///
/// # Errors
/// [`Error::Camera`](crate::Error::Camera) for an empty image.
pub fn room(room: Room, seed: u64, width: usize, height: usize) -> Result<Scene> {
    let world = World::new(room, seed)?;
    Ok(world.render(&world.camera(width, height)?, &Pose::identity()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The tree only saves work.
    #[test]
    fn the_tree_finds_what_a_search_of_all_bodies_finds() {
        for kind in Room::ALL {
            let world = World::new(kind, 2).unwrap();
            let (bodies, _) = rooms::furnish(kind, 2);
            let camera = world.camera(24, 18).unwrap();
            for (y, x) in (0..18).flat_map(|y| (0..24).map(move |x| (y, x))) {
                let ray = world.setting.eye.ray(&camera, f64::from(x), f64::from(y));
                let all = bodies.iter().filter_map(|body| body.meet(&ray, f64::INFINITY)).map(|c| c.t);
                let expected = all.fold(f64::INFINITY, f64::min);
                let found = world.bodies.nearest(&ray, f64::INFINITY).map(|(_, contact)| contact.t);
                assert_eq!(found, Some(expected), "{kind} {x} {y}");
            }
        }
    }
}
