#![doc = include_str!("../README.md")]

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

pub use error::{Error, Result};
pub use gaussian::GaussianDepth;
pub use ndarray;
pub use scalar::Real;
