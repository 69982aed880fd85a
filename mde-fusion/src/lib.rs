//! Fusion of a monocular depth map with the depth that a radiance field renders (Eq. 6-17).
//!
//! Two noisy observations of one scene: a prior \\(D_o\\) that is right on the whole and soft at edges, and rendered
//! views with a variance per pixel. The views are averaged by precision (Eq. 7-8), brought to the prior's scale by
//! weighted least squares (Eq. 10-13), the prior's own variance follows from what is left (Eq. 14-15), and each pixel
//! becomes the posterior of the two (Eq. 16-17). There is nothing to tune.
//!
//! [`BayesFuser`] does all of it behind the trait [`Fuser`]; each equation is also a function of its own:
//!
//! | Equation | Function | Alternatives |
//! |---|---|---|
//! | 7-8 aggregation | [`aggregate`], [`precision_weighted`] | [`Aggregation`], [`mixture_variance`] |
//! | 10 affine map | [`Affine::apply`] | |
//! | 11-13 least squares | [`affine_wls`] | [`affine_ols`], [`affine_effective`] |
//! | 14 residuals | [`residuals`] | |
//! | 15 empirical Bayes | [`empirical_bayes`] | [`paule_mandel`], [`maximum_likelihood`], [`Heteroscedastic`] |
//! | 16-17 posterior | [`posterior`] | [`Fusion::NerfOnly`] |
//!
//! ```
//! use mde_fusion::{Gaussian, posterior};
//!
//! let prior = Gaussian::new(3.0, 0.04); // 3 m, give or take 20 cm
//! let views = Gaussian::new(3.3, 0.01); // 3.3 m, give or take 10 cm
//! let refined = posterior(prior, views);
//! assert!((refined.mean - 3.24).abs() < 1e-12 && (refined.variance - 0.008).abs() < 1e-12);
//! ```
//!
//! Depth is z in the prior's unit, variance in that unit squared; maps are `[height, width]`, missing where the
//! variance is infinite (\\(\tau = 0\\)), and never NaN. All sums are `f64`, in a fixed order. Features: `serde` for
//! configuration and report, `gmrf` for a posterior over whole maps (with faer), `proptest` for the strategies of the property tests.

mod affine;
mod aggregate;
mod bayes;
mod config;
mod disparity;
mod effective;
mod empirical_bayes;
mod error;
mod fuser;
mod gaussian;
#[cfg(feature = "gmrf")]
pub mod gmrf;
mod guards;
mod heteroscedastic;
mod maximum_likelihood;
mod nnls;
mod paule_mandel;
mod posterior;
mod precision;
mod prior;
#[cfg(feature = "proptest")]
pub mod proptest;
mod report;
mod residual;
mod root;
mod spread;
mod variance;
mod working;

pub use affine::{Affine, AffineFit, affine_ols, affine_wls};
pub use aggregate::{Aggregation, aggregate};
pub use bayes::BayesFuser;
pub use config::{Calibration, Fusion, FusionConfig, MissingPrior, OnDegenerate, PriorVariance, Space};
pub use disparity::{to_depth, to_disparity};
pub use effective::{EffectiveConfig, affine_effective};
pub use empirical_bayes::{empirical_bayes, prior_variance_moments};
pub use error::{Error, Result};
pub use fuser::{Fused, Fuser};
pub use gaussian::{Gaussian, Sample};
pub use guards::{Degenerate, Guards};
pub use heteroscedastic::{Heteroscedastic, squared_gradient};
pub use maximum_likelihood::{likelihood_score, maximum_likelihood};
pub use mde_uncertainty::GaussianDepth;
pub use ndarray;
pub use nnls::nnls3;
pub use paule_mandel::{huber_variance, paule_mandel};
pub use posterior::{nerf_weight, posterior};
pub use precision::{mixture_variance, precision_weighted};
pub use prior::Prior;
pub use report::{FusionReport, Warning};
pub use residual::{Residual, residuals};
pub use variance::{VarianceRule, variance_floor, with_variance};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
