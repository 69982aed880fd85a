//! Gaussian depth maps, and the distribution of where a ray ends.
//!
//! Two things live here, and every other stage speaks in them:
//!
//! * [`GaussianDepth`]: a depth map with a variance per pixel. A pixel that nothing is known about has infinite
//!   variance, that is precision 0 (the paper's \\(\tau = 0\\)); NaN never gets in.
//! * [`termination`]: opacity, transmittance and weights of a ray (Eq. 2-3), and the mean and variance of the depth
//!   at which it ends (Eq. 4-5), computed about the mean so that `f32` loses nothing.
//!
//! ```
//! use mde_uncertainty::termination::{InBinVariance, moments, weights};
//!
//! // Three bins, one metre wide each; almost all of the density sits in the middle one.
//! let mut w = [0.0_f64; 3];
//! let escaped = weights(&[0.01, 9.0, 0.5], &[1.0, 1.0, 1.0], &mut w);
//! let end = moments(&w, &[0.5, 1.5, 2.5], &[1.0, 1.0, 1.0], InBinVariance::Midpoint);
//! assert!((end.mean - 1.5).abs() < 0.02 && end.variance < 0.02);
//! assert!((end.opacity + escaped - 1.0).abs() < 1e-12);
//! ```

mod error;
mod gaussian;
#[cfg(feature = "proptest")]
pub mod proptest;
mod scalar;
pub mod termination;

pub use error::{Error, Result};
pub use gaussian::GaussianDepth;
pub use ndarray;
pub use scalar::Real;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
