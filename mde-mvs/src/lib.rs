//! Multi-view stereo on a CPU: several photographs of one scene become a depth hypothesis with a variance for each of them.
//!
//! Photographs come as [`PosedView`](mde_warp::PosedView)s (cameras x right, y down, z forward, pixel centres at integers;
//! poses from world to camera), each with the depth of a monocular prior. [`consensus::reconstruct`] runs every step; each
//! is a function of its own as well:
//!
//! | step | function |
//! | --- | --- |
//! | selection of photographs by parallax, overlap and sharpness | [`views::select_views`] |
//! | scale and gauge of the priors | [`scale::Scale`], [`scale::Gauge`] |
//! | depth of one photograph by comparison with others | [`sweep::sweep`] |
//! | number of photographs that confirm a depth | [`consensus::agreement`] |
//! | all of the above, sweep and prior fused | [`consensus::reconstruct`] |
//! | gain and bias between photographs | [`exposure::fit_exposure`] |
//! | colour error of a withheld photograph | [`withheld::withheld_error`] |
//! | poses from matches and priors, or refinement of given poses | [`poses::estimate_poses`], [`poses::refine_poses`] |
//! | one scale for the priors of a burst or a video | [`poses::ScaleMatches`], [`poses::common_scale`] |
//!
//! ```
//! use mde_mvs::consensus::reconstruct;
//! use mde_mvs::ndarray::{Array2, Array3};
//! use mde_mvs::silent;
//! use mde_warp::{PinholeCamera, Pose, PosedView};
//!
//! let camera = PinholeCamera::from_fov(60.0, 64, 48)?;
//! // Two photographs of a textured wall at depth 2; the second camera is 0.2 to the right.
//! let photograph = |shift: f64| {
//!     let pixels = camera.fx * shift / 2.0;
//!     let grey = |y: usize, x: usize| {
//!         let (u, v) = (x as f64 + pixels, y as f64);
//!         (0.5 + 0.2 * (0.7 * u + 0.2 * v).sin() + 0.2 * (0.31 * u - 0.6 * v).sin()) as f32
//!     };
//!     let image = Array3::from_shape_fn((48, 64, 3), |(y, x, _)| grey(y, x));
//!     let mask = Array2::from_elem((48, 64), true);
//!     PosedView::new(image, camera, Pose::translation(-shift, 0.0, 0.0), mask, Vec::new())
//! };
//! let views = [photograph(0.0)?, photograph(0.2)?];
//! // The prior has another unit, in which the depth of the wall is 5.
//! let prior = Array2::from_elem((48, 64), 5.0_f32);
//!
//! let found = reconstruct(&views, &[prior.view(), prior.view()], None, &mut silent)?;
//! let depth = &found.views[0].fused;
//! assert!((depth.mean()[(24, 40)] - 2.0).abs() < 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Features
//! `capture`: readers of nerfstudio's `transforms.json`, COLMAP models and TUM trajectories, and writers of the first two, in `capture`.
//! `serde`: settings and reports can be read and written. `surface`: one mesh of many depth maps, in `surface`, and files of points and
//! meshes, in `export`.

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

use mde_warp::PinholeCamera;
use std::ops::ControlFlow;

/// Progress callback: the pieces of work that are done, and their number. `Break` ends the work with [`Error::Interrupted`].
pub type Callback<'c> = dyn FnMut(usize, usize) -> ControlFlow<()> + 'c;

/// A callback that reports to nobody.
pub fn silent(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// An error where the callback ends the work.
fn notify(callback: &mut Callback<'_>, done: usize, all: usize) -> Result<()> {
    match callback(done, all) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}

/// An error unless a map has its camera's size.
fn check_map(what: &'static str, found: (usize, usize), camera: &PinholeCamera) -> Result<()> {
    if found == camera.dim() {
        return Ok(());
    }
    let (found, expected) = (vec![found.0, found.1], vec![camera.height, camera.width]);
    Err(mde_warp::Error::Shape { what, found, expected }.into())
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
