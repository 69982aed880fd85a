//! Fusion of a monocular depth map with the depth that a radiance field renders (Eq. 7-17).
//!
//! The prior \\(D_o\\) is accurate at low frequencies and blurred at edges; the rendered views have a variance per pixel. The
//! views are averaged by precision (Eq. 7-8) and mapped affinely onto the prior (Eq. 10-13), the variance of the prior is
//! estimated from the residuals (Eq. 14-15), and each pixel becomes the posterior of the two (Eq. 16-17).
//!
//! [`BayesFuser`] does all of it behind the trait [`Fuser`]. Each equation is also a function:
//!
//! | Equation | Function | Alternatives in [`FusionConfig`] |
//! |---|---|---|
//! | 7-8 aggregation | [`aggregate`], [`precision_weighted`] | [`Aggregation`] |
//! | 10 affine map | [`Affine::apply`] | |
//! | 11-13 least squares | [`affine_wls`] | [`Calibration`] |
//! | 14 residuals | [`residuals`] | |
//! | 15 empirical Bayes | [`empirical_bayes`] | [`PriorVariance`] |
//! | 16-17 posterior | [`posterior`] | [`Fusion`] |
//!
//! ```
//! use mde_fusion::{Gaussian, posterior};
//!
//! let prior = Gaussian::new(3.0, 0.04); // 3 m, standard deviation 20 cm
//! let views = Gaussian::new(3.3, 0.01); // 3.3 m, standard deviation 10 cm
//! let refined = posterior(prior, views);
//! assert!((refined.mean - 3.24).abs() < 1e-12 && (refined.variance - 0.008).abs() < 1e-12);
//! ```
//!
//! Depth is z in the prior's unit, variance in that unit squared. Maps are `[height, width]` and never NaN. An infinite variance
//! (\\(\tau = 0\\)) is a missing pixel, a variance of 0 an exact depth; a prior whose error is not known has no variance at all
//! ([`Prior::new`]). Sums are `f64`, in a fixed order. Feature: `serde`, for configuration and
//! report.

mod affine;
mod aggregate;
mod bayes;
mod config;
mod error;
mod gaussian;
mod posterior;
mod prior;
mod report;
mod residual;
mod robust;
#[cfg(test)]
mod tests;

pub use affine::{Affine, AffineFit, Degenerate, affine_wls};
pub use aggregate::{Aggregation, aggregate, precision_weighted};
pub use bayes::{BayesFuser, Fused, Fuser};
pub use config::{Calibration, Fusion, FusionConfig, PriorVariance, VarianceRule};
pub use error::{Error, Result};
pub use gaussian::{Gaussian, Sample};
pub use mde_uncertainty::GaussianDepth;
pub use ndarray;
pub use posterior::posterior;
pub use prior::Prior;
pub use report::{FusionReport, Warning};
pub use residual::{Residual, empirical_bayes, residuals};
pub use robust::{LinePoint, RobustLine};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
