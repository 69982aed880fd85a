#![doc = include_str!("../README.md")]
//!
//! A [`Refiner`] takes a [`Scene`], one photograph or several, to depth with a standard deviation per pixel. It composes three traits: a
//! [`DepthPrior`](mde_prior::DepthPrior) gives a monocular depth, a [`RadianceField`](mde_nerf::RadianceField) is fitted to views warped by
//! it or to further photographs, a [`Fuser`](mde_fusion::Fuser) combines its renderings with the prior (the paper's Section III). [`refine`]
//! is the loop alone: its [`Stages`] take any prior, field and fusion. A [`Config`] has the settings; [`Preset`]s are its starting points.

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
pub use {mde_fusion, mde_mvs, mde_nerf, mde_prior, mde_uncertainty, mde_warp};
pub use {nalgebra, ndarray};

// The package has no documents of the workspace; build.rs sets the flag where they exist.
#[cfg(all(doctest, documents))]
#[doc = include_str!("../../docs/architecture.md")]
struct Architecture;
