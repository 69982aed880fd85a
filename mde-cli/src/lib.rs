//! The refinement of monocular depth as a library; the program `mde` is built on it.
//!
//! A [`Refiner`] takes a [`Scene`], one photograph or several, to depth with a standard deviation per pixel. It composes three traits: a
//! [`DepthPrior`](mde_prior::DepthPrior) gives a monocular depth, a [`RadianceField`](mde_nerf::RadianceField) is fitted to views warped by
//! it or to further photographs, a [`Fuser`](mde_fusion::Fuser) combines its renderings with the prior (the paper's Section III). [`refine`]
//! is the loop alone: its [`Stages`] take any prior, field and fusion. A [`Config`] has the settings; [`Preset`]s are its starting points.
//!
//! ```
//! use mde_eval::scene::{Room, room};
//! use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
//! use mde_cli::{Config, Event, Preset, Stages, refine};
//! use std::ops::ControlFlow;
//!
//! // Far fewer steps than a useful run has (2000).
//! let config = Config::with_overrides(Preset::Paper, "nerf.train.steps = 10", "here")?;
//! let scene = room(Room::Study, 0, 64, 48)?;
//! let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
//!
//! let mut progress = |_: &Event| ControlFlow::Continue(());
//! let refined = refine(scene.image.view(), &scene.camera, Stages::new(&prior), &config, &mut progress)?;
//! assert_eq!(refined.depth.dim(), (48, 64));
//! assert_eq!(refined.iterations.len(), 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod config;
pub mod error;
#[cfg(feature = "files")]
pub mod output;
pub mod prior;
#[cfg(feature = "program")]
pub mod program;
pub mod refinement;
pub mod refiner;
pub mod reports;
pub mod scene;
pub mod several;

pub use config::{Config, MultiViewConfig, Preset, SigmaConfig};
pub use error::{Error, Result};
pub use prior::OpenPrior;
pub use refinement::event::{Callback, Event, Stage};
pub use refinement::refine;
pub use refinement::stages::{FieldFactory, FieldRequest, Stages};
pub use refiner::{Observer, Plan, Prepared, Refined, Refiner, Settings};
pub use reports::Refinement;
pub use scene::{Photograph, Scene};
pub use several::refine_several;
pub use {mde_fusion, mde_mvs, mde_nerf, mde_prior, mde_uncertainty, mde_warp};
pub use {nalgebra, ndarray};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

// The package has no documents of the workspace; build.rs sets the flag where they exist.
#[cfg(all(doctest, documents))]
#[doc = include_str!("../../docs/architecture.md")]
struct Architecture;
