#![doc = include_str!("../README.md")]
//!
//! With the weights \\( w_i \\) of the bins of a ray and their middles \\( z_i \\), [`termination::moments`] gives the mean and the variance of the
//! depth at which it ends (Eq. 4-5),
//!
//! \\[ \bar z = \frac{\sum_i w_i z_i}{\sum_i w_i}, \qquad \sigma^2 = \frac{\sum_i w_i (z_i - \bar z)^2}{\sum_i w_i} . \\]

#[cfg(feature = "calibration")]
pub mod calibration;
mod error;
pub mod filter;
mod gaussian;
pub mod normal;
pub mod pooled;
#[cfg(any(test, feature = "proptest"))]
pub mod proptest;
#[cfg(feature = "random")]
pub mod random;
mod scalar;
pub mod statistics;
pub mod termination;

pub use error::{Error, OutOfRange, Result};
pub use gaussian::GaussianDepth;
pub use ndarray;
pub use scalar::Real;
