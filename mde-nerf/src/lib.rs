#![doc = include_str!("../README.md")]
//!
//! [`RadianceField`] is the trait, [`Nerf`] its implementation on the frustum of view 0, trained by Adam on random rays. Rendered depths
//! are the mean and the variance of each ray's termination distribution (Eq. 2-5 of the paper, in [`mde_uncertainty::termination`]).
//!
//! # Gradients
//!
//! There is no automatic differentiation in a fit: the adjoints of encoding, network, compositing and losses are derived by
//! hand, for `f32` with vector kernels and for `f64` with plain loops. The tests check the `f64` adjoints against dual
//! numbers (forward-mode derivatives of the same generic code, exact to rounding) and against central differences, and the
//! `f32` ones against the `f64` ones. Gradients exist for the parameters only; poses and positions are constants of a fit.

mod batch;
mod config;
#[cfg(test)]
mod dual;
mod encoding;
mod error;
mod field;
mod frustum;
mod gemm;
#[cfg(test)]
mod gradient_check;
mod loss;
mod march;
#[cfg(feature = "bench")]
pub mod measure;
mod memory;
mod mlp;
mod nerf;
mod network;
mod optimiser;
mod points;
mod render;
mod sampling;
mod scalar;
#[cfg(feature = "bench")]
pub mod stages;
mod store;
mod train;
mod volume;

pub use config::{
    ColourLoss, FieldConfig, HashFieldConfig, MlpFieldConfig, NerfConfig, RenderConfig, SamplingConfig,
    TrainConfig, VolumeConfig,
};
pub use error::{Error, Result};
pub use field::{FieldCallback, FieldEvent, FitReport, RadianceField, RenderedView, silent};
pub use nerf::Nerf;
pub use {mde_uncertainty, mde_warp, nalgebra, ndarray};
