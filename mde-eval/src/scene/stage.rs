//! Putting solids into a room. Room coordinates: x right, y into the room, z up, in metres, floor at 0.

use super::solid::{Body, Shape, Vector};
use super::texture::{Colour, Material, Texture, rgb};
use mde_uncertainty::random::CounterRng;
use nalgebra::{Matrix3, Rotation3};
use rand::RngExt;

/// Lengths along x, y and z, or a colour.
type Triple = [f64; 3];
type Turn = Rotation3<f64>;

/// The frame of a piece of furniture: where it stands and how far it is turned about the vertical.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    origin: Vector,
    yaw: f64,
}

impl Stand {
    pub(super) fn at(x: f64, y: f64, z: f64) -> Self {
        Self { origin: Vector::new(x, y, z), yaw: 0.0 }
    }

    /// Turned to the left (seen from above) by degrees.
    pub(super) fn turned(self, degrees: f64) -> Self {
        Self { yaw: self.yaw + degrees.to_radians(), ..self }
    }

    /// A frame given in this one.
    pub(super) fn then(&self, x: f64, y: f64, z: f64) -> Self {
        Self { origin: self.to_room(Vector::new(x, y, z)), yaw: self.yaw }
    }

    fn rotation(&self) -> Turn {
        Rotation3::from_axis_angle(&Vector::z_axis(), self.yaw)
    }

    fn to_room(self, local: Vector) -> Vector {
        self.origin + self.rotation() * local
    }
}

pub(super) struct Stage {
    pub(super) bodies: Vec<Body>,
    rng: CounterRng,
}

impl Stage {
    pub(super) fn new(seed: u64, room: &str) -> Self {
        Self { bodies: Vec::new(), rng: CounterRng::new(seed, room, 0, 0) }
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.rng.random::<f64>()
    }

    /// A colour around the given one.
    pub(super) fn about(&mut self, colour: Triple, spread: f64) -> Colour {
        let [r, g, b] = colour.map(|c| (c + self.between(-spread, spread)).clamp(0.02, 0.98));
        rgb(r, g, b)
    }

    /// A box by its centre and full size, in the stand's frame.
    pub(super) fn block(&mut self, stand: &Stand, centre: Triple, size: Triple, material: Material) {
        self.tilted(stand, centre, size, Rotation3::identity(), material);
    }

    /// A box turned about its own centre.
    pub(super) fn tilted(&mut self, stand: &Stand, at: Triple, size: Triple, turn: Turn, material: Material) {
        self.push(stand, at, turn, Shape::Block(0.5 * Vector::from(size)), material);
    }

    pub(super) fn ellipsoid(
        &mut self,
        stand: &Stand,
        at: Triple,
        radii: Triple,
        turn: Turn,
        material: Material,
    ) {
        self.push(stand, at, turn, Shape::Ellipsoid(radii.into()), material);
    }

    pub(super) fn ball(&mut self, stand: &Stand, centre: Triple, radius: f64, material: Material) {
        self.ellipsoid(stand, centre, [radius; 3], Rotation3::identity(), material);
    }

    pub(super) fn rod(&mut self, stand: &Stand, from: Triple, to: Triple, radius: f64, material: Material) {
        self.cone(stand, from, to, [radius, radius], material);
    }

    /// A capped cone between two points, with the radius at each.
    pub(super) fn cone(
        &mut self,
        stand: &Stand,
        from: Triple,
        to: Triple,
        radii: [f64; 2],
        material: Material,
    ) {
        let along = Vector::from(to) - Vector::from(from);
        let shape = Shape::Frustum { length: along.norm(), bottom: radii[0], top: radii[1] };
        // Opposite directions have no unique rotation: any half turn will do.
        let turn = Rotation3::rotation_between(&Vector::z(), &along)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI));
        self.push(stand, from, turn, shape, material);
    }

    fn push(&mut self, stand: &Stand, at: Triple, turn: Turn, shape: Shape, material: Material) {
        let to_local: Matrix3<f64> = (stand.rotation() * turn).inverse().into_inner();
        self.bodies.push(Body { shape, origin: stand.to_room(at.into()), to_local, material });
    }
}

/// A turn about the stand's x axis (leaning back is positive), then about z, in degrees.
pub(super) fn lean(about_x: f64, about_z: f64) -> Turn {
    Rotation3::from_axis_angle(&Vector::z_axis(), about_z.to_radians())
        * Rotation3::from_axis_angle(&Vector::x_axis(), about_x.to_radians())
}

pub(super) fn wood(light: Triple, dark: Triple, seed: f64) -> Material {
    let colours = [light, dark].map(|[r, g, b]| rgb(r, g, b));
    Material::new(Texture::Wood(colours, seed)).gloss(0.08)
}

pub(super) fn oak(seed: f64) -> Material {
    wood([0.82, 0.66, 0.45], [0.58, 0.41, 0.24], seed)
}

pub(super) fn walnut(seed: f64) -> Material {
    wood([0.52, 0.35, 0.22], [0.28, 0.17, 0.10], seed)
}

pub(super) fn cloth(colour: Colour) -> Material {
    Material::new(Texture::Cloth(colour, 0.004))
}

pub(super) fn metal(tone: f64) -> Material {
    Material::plain(tone, tone, tone * 1.02).gloss(0.6)
}

pub(super) fn enamel(red: f64, green: f64, blue: f64) -> Material {
    Material::plain(red, green, blue).gloss(0.25)
}
