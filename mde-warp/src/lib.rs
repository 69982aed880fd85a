//! Pinhole cameras, sampling of nearby poses, forward warps of colour and depth, and reprojection of Gaussian depth.
//!
//! [`sample_poses`] places synthetic cameras about the original one, [`forward_warp`] renders colour and depth into them
//! with a z-buffer (Section III.A of the paper), and [`reproject`] carries a Gaussian depth map with its variance between
//! cameras (Section III.D). A pixel of ray \\( d \\) (z = 1) and depth \\( z \\) goes to
//!
//! \\[ X' = z R d + t, \qquad z' = (e_z^\top R d)\, z + t_z, \qquad \sigma_{z'}^2 = (e_z^\top R d)^2 \sigma_z^2 . \\]
//!
//! No resulting depth or colour mixes two surfaces.
//!
//! Cameras follow OpenCV (x right, y down, z forward; pixel centres at integers, from 0), poses map world to camera, depth
//! is z in the prior's unit, images are `[height, width, 3]` and maps `[height, width]`.
//!
//! ```
//! use mde_uncertainty::GaussianDepth;
//! use mde_uncertainty::statistics::median;
//! use mde_warp::ndarray::{Array2, Array3};
//! use mde_warp::{PinholeCamera, Pose, ReprojectConfig, ViewSampling, WarpConfig, forward_warp};
//! use mde_warp::{reproject, sample_poses};
//!
//! let camera = PinholeCamera::from_fov(60.0, 64, 48)?;
//! let image = Array3::from_elem((48, 64, 3), 0.5);
//! let slant = Array2::from_shape_fn((48, 64), |(_, column)| 2.0 + 0.01 * column as f32);
//! let depth = GaussianDepth::new(slant, Array2::from_elem((48, 64), 0.01))?;
//!
//! let origin = Pose::identity();
//! let scale = median(depth.mean().iter().copied()).unwrap_or(1.0);
//! for pose in sample_poses(&ViewSampling::default(), scale, 0)? {
//!     let warped = forward_warp(image.view(), &depth, &camera, &origin, &camera, &pose, &WarpConfig::default())?;
//!     assert!(warped.hole_fraction < 0.02);
//!
//!     let there = &warped.view.hypotheses[0];
//!     let back = reproject(there, &camera, &pose, &camera, &origin, &ReprojectConfig::default())?;
//!     assert!((back.mean()[(24, 32)] - depth.mean()[(24, 32)]).abs() < 1e-4);
//! }
//! # Ok::<(), mde_warp::Error>(())
//! ```
//!
//! # Features
//! `serde`: cameras and settings as TOML or JSON. `proptest`: strategies for property tests, in
//! [`proptest`](mod@proptest).

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

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
