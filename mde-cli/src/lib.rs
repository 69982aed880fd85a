//! The refinement loop as a library; the program `mde` is built on it.
//!
//! [`refine`] composes three traits and nothing else: a [`DepthPrior`](mde_prior::DepthPrior) gives a monocular
//! depth, a [`RadianceField`](mde_nerf::RadianceField) is fitted to views warped by it, a [`Fuser`](mde_fusion::Fuser)
//! combines what the field renders with the prior (the paper's Section III). [`Preset`]s and [`Config`] hold every choice.
//!
//! ```
//! use mde_cli::mde_eval::scene::{Room, room};
//! use mde_cli::mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
//! use mde_cli::mde_fusion::BayesFuser;
//! use mde_cli::mde_nerf::{Nerf, RadianceField};
//! use mde_cli::{Config, Event, Preset, Stages, refine};
//! use std::ops::ControlFlow;
//!
//! // Much less than a useful run needs: 2000 steps.
//! let config = Config::with_overrides(Preset::Fast, "nerf.train.steps = 10", "here")?;
//! let scene = room(Room::Study, 0, 64, 48)?;
//! let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
//! let fuser = BayesFuser::new(config.fusion.clone())?;
//! let mut field = |_iteration: usize| -> mde_cli::Result<Box<dyn RadianceField>> {
//!     Ok(Box::new(Nerf::new(config.nerf.clone(), config.seed)?))
//! };
//!
//! let stages = Stages { prior: &prior, field: &mut field, fuser: &fuser };
//! let mut go_on = |_: &Event| ControlFlow::Continue(());
//! let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut go_on)?;
//! assert_eq!(refined.depth.dim(), (48, 64));
//! assert_eq!(refined.iterations.len(), 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod augmentation;
mod calibration;
pub mod config;
mod control;
mod error;
mod intrinsics;
pub mod memory;
pub mod pipeline;
mod report;

pub use augmentation::{AugmentationReport, Component};
pub use calibration::{Calibration, CalibrationSource, HeldOut};
pub use config::{Config, Preset, SigmaConfig};
pub use control::AveragedField;
pub use error::{Error, Result};
pub use intrinsics::Intrinsics;
pub use pipeline::{Checkpoint, Event, Refinement, Stage, Stages, refine, resume};
pub use report::{IterationReport, StageSeconds, WarpReport};
pub use {mde_eval, mde_fusion, mde_nerf, mde_prior, mde_uncertainty, mde_warp};
pub use {nalgebra, ndarray};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

// The workspace's documents are not in the package; build.rs says whether they are here.
#[cfg(all(doctest, documents))]
#[doc = include_str!("../../docs/architecture.md")]
struct Architecture;
