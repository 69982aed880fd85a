//! Small neural radiance fields that fit on a CPU, for what their rays say about depth.
//!
//! * [`RadianceField`] is the trait: fit posed views, render a view with colour and Gaussian depth.
//! * [`Nerf`] is the field: a light MLP on a frequency encoding or a multiresolution hash grid, in the frustum of the
//!   original camera, trained by Adam on random rays with gradients written by hand.
//! * Its renders give the mean and the variance of each ray's termination (the paper's Eq. 2-5, in
//!   [`mde_uncertainty::termination`]).
//! * The same seed gives the same bits with any number of threads.
//!
//! See [`Nerf`] for an example.

mod batch;
mod config;
mod encoding;
mod error;
mod field;
mod frustum;
mod gemm;
#[cfg(test)]
mod gradient_check;
mod loss;
mod march;
mod mlp;
mod nerf;
mod network;
mod optimiser;
mod points;
mod render;
mod sampling;
mod scalar;
pub mod stages;
#[cfg(feature = "serde")]
mod store;
mod train;
mod volume;

pub use config::{
    DepthLoss, FieldConfig, HashFieldConfig, MlpFieldConfig, NerfConfig, RenderConfig, SamplingConfig,
    SmoothnessConfig, Spacing, TrainConfig,
};
pub use error::{Error, Result};
pub use field::{Event, FitReport, Observer, RadianceField, RenderedView, Silent};
pub use nerf::Nerf;
pub use {mde_uncertainty, mde_warp, nalgebra, ndarray};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
