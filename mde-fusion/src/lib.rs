#![doc = include_str!("../README.md")]
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
//! Maps are `[height, width]` and never NaN; variance is in the depth's unit squared. Sums are `f64`, in a fixed order.

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
