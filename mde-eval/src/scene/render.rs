//! Light and colour: the mean over a grid of rays in each pixel, so that the image is smooth.

use super::World;
use super::noise::lattice;
use super::solid::{Body, Contact, Ray, Vector};
use super::texture::Colour;
use crate::capture::on_sphere;
use mde_warp::{PinholeCamera, Pose};
use ndarray::{Array3, indices};
use rayon::prelude::*;

/// Rays a pixel has along each side.
const GRID: usize = 3;
/// How far a corner darkens what is near it, in metres.
const AMBIENT_REACH: f64 = 0.9;

/// A spherical light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Light {
    pub(super) position: Vector,
    /// Size of the light, which softens its shadows.
    pub(super) radius: f64,
    pub(super) colour: Colour,
}

/// The camera's place in room coordinates: origin, and the directions of its x, y and z axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eye {
    pub(super) origin: Vector,
    pub(super) axes: [Vector; 3],
}

impl Eye {
    /// Looks into the room: `yaw` degrees to the left, `pitch` degrees down.
    pub(super) fn new(origin: Vector, yaw: f64, pitch: f64) -> Self {
        let ((sin_yaw, cos_yaw), (sin, cos)) = (yaw.to_radians().sin_cos(), pitch.to_radians().sin_cos());
        let forward = Vector::new(-sin_yaw * cos, cos_yaw * cos, -sin);
        let right = Vector::new(cos_yaw, sin_yaw, 0.0);
        Self { origin, axes: [right, forward.cross(&right), forward] }
    }

    /// The eye of a camera whose world is this one's frame.
    pub(super) fn moved(&self, pose: &Pose) -> Self {
        let to_world = pose.inverse();
        let to_room = |v: Vector| self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z;
        let axis = |v: Vector| to_room(to_world.rotation * v);
        Self {
            origin: self.origin + to_room(to_world.translation.vector),
            axes: [axis(Vector::x()), axis(Vector::y()), axis(Vector::z())],
        }
    }

    /// The ray through a point of the image, its direction with z = 1 in the camera, so that t is the z-depth.
    pub(super) fn ray(&self, camera: &PinholeCamera, x: f64, y: f64) -> Ray {
        let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
        Ray { origin: self.origin, direction: self.axes[0] * u + self.axes[1] * v + self.axes[2] }
    }
}

impl World {
    /// The image, `[height, width, 3]`, sRGB in 0 to 1.
    pub(super) fn image(&self, camera: &PinholeCamera, eye: &Eye) -> Array3<f32> {
        let mut image = Array3::zeros((camera.height, camera.width, 3));
        let mut rows: Vec<_> = image.outer_iter_mut().enumerate().collect();
        rows.par_iter_mut().for_each(|(y, row)| {
            for (x, mut pixel) in row.outer_iter_mut().enumerate() {
                let light = self.pixel(camera, eye, x, *y) * self.exposure;
                pixel.iter_mut().zip(&light).for_each(|(value, light)| *value = encode(*light));
            }
        });
        image
    }

    /// An exposure that maps the mean of the log radiance to middle grey.
    pub(super) fn metered(&self, camera: &PinholeCamera) -> f64 {
        let log = |(y, x)| (1e-4 + self.pixel(camera, &self.setting.eye, x, y).mean()).ln();
        let logs = indices(camera.dim()).into_iter().map(log);
        0.24 / (logs.sum::<f64>() / (camera.width * camera.height).max(1) as f64).exp()
    }

    /// Light through one pixel: the mean over a grid of rays.
    fn pixel(&self, camera: &PinholeCamera, eye: &Eye, x: usize, y: usize) -> Colour {
        let mut sum = Colour::zeros();
        for k in 0..GRID * GRID {
            let offset = |k: usize| (k as f64 + 0.5) / GRID as f64 - 0.5;
            let (dx, dy) = (offset(k % GRID), offset(k / GRID));
            let ray = eye.ray(camera, x as f64 + dx, y as f64 + dy);
            if let Some((body, contact)) = self.bodies.nearest(&ray, f64::INFINITY) {
                sum += self.shade(&ray, body, &contact, &Dither { x, y, k });
            }
        }
        sum / (GRID * GRID) as f64
    }

    fn shade(&self, ray: &Ray, body: &Body, contact: &Contact, dither: &Dither) -> Colour {
        let material = &body.material;
        let colour = material.texture.colour(&body.shape, contact.point, contact.normal);
        let normal = body.to_local.transpose() * contact.normal;
        let point = ray.origin + ray.direction * contact.t + normal * 1e-5;
        let eye = -ray.direction.normalize();
        let open = self.openness(point, normal, dither);
        // Floors and tables throw some of the light back up.
        let mut light = self.setting.ambient * (open * (0.75 + 0.25 * normal.z));
        let mut shine = 0.0;
        for (index, lamp) in self.setting.lights.iter().enumerate() {
            let aim = lamp.position + dither.on_sphere(index) * lamp.radius - point;
            let distance = aim.norm();
            let towards = aim / distance;
            let facing = normal.dot(&towards);
            let shadow = Ray { origin: point, direction: towards };
            if facing <= 0.0 || self.bodies.blocked(&shadow, distance) {
                continue;
            }
            light += lamp.colour * (facing / (distance * distance + 0.05));
            let half = (towards + eye).normalize();
            shine += material.gloss * normal.dot(&half).max(0.0).powi(40) / (0.5 + distance);
        }
        colour.component_mul(&light) + Colour::repeat(shine * 0.6) + colour * material.glow
    }

    /// Ambient visibility of a point, 0 to 1, by one ray of a stratified hemisphere.
    fn openness(&self, point: Vector, normal: Vector, dither: &Dither) -> f64 {
        let direction = (normal + dither.on_sphere(50)).try_normalize(1e-9).unwrap_or(normal);
        let limit = AMBIENT_REACH;
        match self.bodies.nearest(&Ray { origin: point, direction }, limit) {
            Some((body, contact)) if body.material.glow == 0.0 => 0.35 + 0.65 * (contact.t / limit).sqrt(),
            _ => 1.0,
        }
    }
}

/// Fixed, well-spread offsets for the rays of a pixel: strata by sub-pixel, turned by pixel.
struct Dither {
    x: usize,
    y: usize,
    k: usize,
}

impl Dither {
    /// A point of the unit sphere; those of the sub-pixels of one pixel fill it evenly.
    fn on_sphere(&self, purpose: usize) -> Vector {
        let turn = |axis: i64| lattice(self.x as i64, self.y as i64, purpose as i64 * 2 + axis);
        let cell = (self.k * 5 + purpose * 2) % (GRID * GRID);
        let at = |cell: usize, shift: f64| (cell as f64 + shift) / GRID as f64;
        on_sphere(1.0 - 2.0 * at(cell % GRID, turn(100)), at(cell / GRID, turn(101)))
    }
}

/// Soft shoulder for highlights, then the sRGB transfer curve.
fn encode(light: f64) -> f32 {
    const KNEE: f64 = 0.6;
    let rolled =
        if light <= KNEE { light } else { 1.0 - (1.0 - KNEE) * ((KNEE - light) / (1.0 - KNEE)).exp() };
    let encoded = if rolled <= 0.003_130_8 { 12.92 * rolled } else { 1.055 * rolled.powf(1.0 / 2.4) - 0.055 };
    encoded.clamp(0.0, 1.0) as f32
}
