#![doc = include_str!("../README.md")]

#[cfg(feature = "capture")]
pub mod capture;
pub mod cloud;
mod error;
#[cfg(feature = "surface")]
pub mod export;
pub mod poses;
mod raster;
mod statistics;
#[cfg(feature = "surface")]
pub mod surface;
pub mod sweep;
#[cfg(test)]
mod synthetic;

pub use error::{Error, Result};
pub use sweep::{consensus, evidence, exposure, patches, planes, scale, sigma, views, withheld};
pub use {nalgebra, ndarray};

use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Point3, Vector3};
use std::ops::ControlFlow;

/// Progress callback: the pieces of work that are done, and their number. `Break` ends the work with [`Error::Interrupted`].
pub type Callback<'c> = dyn FnMut(usize, usize) -> ControlFlow<()> + 'c;

/// A callback that reports to nobody.
pub fn silent(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// An error where the callback ends the work.
fn notify(callback: &mut Callback<'_>, done: usize, all: usize) -> Result<()> {
    if callback(done, all).is_continue() { Ok(()) } else { Err(Error::Interrupted) }
}

/// The place of a camera in the world.
fn centre(pose: &Pose) -> Vector3<f64> {
    pose.inverse().translation.vector
}

/// The nearest pixel, row and column, of a point in the frame of the camera, where it lies on the image.
fn nearest_pixel(camera: &PinholeCamera, point: &Point3<f64>) -> Option<(usize, usize)> {
    let [x, y] = camera.project(point)?.coords.map(f64::round).into();
    let inside = x >= 0.0 && y >= 0.0 && x < camera.width as f64 && y < camera.height as f64;
    inside.then_some((y as usize, x as usize))
}
