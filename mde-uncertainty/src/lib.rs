//! Depth maps with a variance per pixel, and the statistics that the other stages share.
//!
//! * [`GaussianDepth`]: a depth map with a variance per pixel. A missing pixel has infinite variance, that is precision 0
//!   (the paper's \\(\tau = 0\\)); no value is NaN.
//! * [`termination`]: opacity, transmittance and weights of a ray (Eq. 2-3), and the mean and variance of the depth
//!   at which it ends (Eq. 4-5), computed about the mean so that `f32` keeps its digits.
//! * [`statistics`]: quantiles, the median and Spearman's correlation; [`normal`]: the normal distribution.
//! * [`filter`]: a Gaussian blur and a joint bilateral filter of maps.
//! * [`pooled`]: intervals of a stated probability, estimated on scenes of known depth.
//! * `random` (feature `random`): counter-based random numbers and derived seeds.
//! * `calibration` (feature `calibration`): the file of a calibration.
//!
//! ```
//! use mde_uncertainty::termination::{InBinVariance, moments, weights};
//!
//! // Three bins of one metre; almost all of the density is in the second.
//! let mut w = [0.0_f64; 3];
//! let escaped = weights(&[0.01, 9.0, 0.5], &[1.0, 1.0, 1.0], &mut w);
//! let end = moments(&w, &[0.5, 1.5, 2.5], &[1.0, 1.0, 1.0], InBinVariance::Midpoint);
//! assert!((end.mean - 1.5).abs() < 0.02 && end.variance < 0.02);
//! assert!((end.opacity + escaped - 1.0).abs() < 1e-12);
//! ```

#[cfg(feature = "calibration")]
pub mod calibration;
mod error;
pub mod filter;
mod gaussian;
pub mod normal;
pub mod pooled;
#[cfg(feature = "proptest")]
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

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
