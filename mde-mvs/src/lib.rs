//! Multi-view stereo on a CPU: several photographs of one scene become a depth hypothesis with a variance for each of them.

#[cfg(feature = "capture")]
pub mod capture;
pub mod consensus;
mod correction;
mod error;
pub mod exposure;
pub mod gauge;
mod geometry;
pub mod poses;
mod raster;
mod statistics;
pub mod sweep;
#[cfg(test)]
mod synthetic;
pub mod views;

pub use error::{Error, Result};
pub use {nalgebra, ndarray};

use mde_warp::PinholeCamera;

/// An error unless a map has its camera's size.
fn check_map(what: &'static str, found: (usize, usize), camera: &PinholeCamera) -> Result<()> {
    if found == camera.dim() {
        return Ok(());
    }
    let (found, expected) = (vec![found.0, found.1], vec![camera.height, camera.width]);
    Err(mde_warp::Error::Shape { what, found, expected }.into())
}
