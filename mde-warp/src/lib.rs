#![doc = include_str!("../README.md")]
//!
//! [`sample_poses`] places synthetic cameras about the original one, [`forward_warp`] renders colour and depth into them with a z-buffer
//! (Section III.A of the paper), and [`reproject`] carries a Gaussian depth map with its variance between cameras (Section III.D).

mod camera;
mod error;
mod holes;
mod mesh;
mod orbit;
mod pose;
#[cfg(feature = "proptest")]
pub mod proptest;
mod raster;
mod reproject;
mod sampling;
mod synthetic;
pub mod transfer;
mod view;
mod warp;
mod zbuffer;

pub use camera::PinholeCamera;
pub use error::{Error, Result};
pub use nalgebra;
pub use ndarray;
pub use orbit::orbit;
pub use pose::{Pose, matrix_rows};
pub use reproject::{ReprojectConfig, reproject};
pub use sampling::{ViewSampling, sample_poses};
pub use synthetic::{WarpReport, synthesise};
pub use view::PosedView;
pub use warp::{WarpConfig, WarpedView, forward_warp};
