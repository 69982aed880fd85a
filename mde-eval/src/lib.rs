//! Metrics of depth maps and of their uncertainty, with alignments, statistics over scenes, and tables.
//!
//! Metrics of depth (errors, edges, order) and of its uncertainty (ranking, calibration) are functions, each with its equation.
//! The paper's numbers are [MSE](metrics::depth::mse), [sharpness](metrics::sharpness), [edge F1](metrics::edges) and
//! [Spearman's correlation](metrics::rank) under [median alignment](align) (its Section IV); [`score`](score::score) returns
//! them and those that contrast and noise do not raise. Behind features: baselines, procedural rooms with exact depth and priors
//! simulated from it, data sets, and figures.
//!
//! Depth is z in metres, maps are `[height, width]`, images `[height, width, 3]` in sRGB 0 to 1. Not positive or not
//! finite means missing.
//!
//! | feature | adds |
//! | --- | --- |
//! | `baseline` | [`Method`], filters and further predictions of the model, trivial sigmas |
//! | `solver` | the fast bilateral solver (faer) |
//! | `scenes` | procedural rooms, simulated priors and models, the check of a model's order of near and far |
//! | `data` | data sets; includes `scenes` |
//! | `plot` | figures as SVG |
//!
//! ```
//! use mde_eval::scene::{Room, room};
//! use mde_eval::score::{ScoreConfig, Subject, score};
//! use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
//!
//! let scene = room(Room::Study, 0, 160, 120)?;
//! let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
//! let sigma = prior.prediction().map.mapv(|z| 0.05 * z);
//!
//! let subject = Subject::new(prior.prediction().map.view(), scene.depth.view()).with_sigma(sigma.view());
//! let scores = score(&subject, &ScoreConfig::default())?;
//! assert!(scores.get("abs_rel").is_some_and(|error| error > 0.0 && error < 0.2));
//! assert!(scores.get("ause_mae").is_some_and(|area| area > 0.0));
//! # Ok::<(), mde_eval::Error>(())
//! ```

pub mod align;
#[cfg(feature = "baseline")]
pub mod baseline;
#[cfg(feature = "scenes")]
pub mod capture;
#[cfg(feature = "data")]
pub mod data;
mod error;
#[cfg(feature = "plot")]
pub mod figure;
#[cfg(feature = "baseline")]
mod method;
pub mod metrics;
#[cfg(feature = "scenes")]
pub mod order_check;
mod raster;
#[cfg(feature = "scenes")]
pub mod scene;
pub mod score;
#[cfg(feature = "scenes")]
pub mod simulated;
pub mod statistics;
pub mod table;

pub use error::{Error, Result};
#[cfg(feature = "scenes")]
pub use mde_mvs;
#[cfg(feature = "prior")]
pub use mde_prior;
pub use mde_uncertainty;
#[cfg(feature = "prior")]
pub use mde_warp;
#[cfg(feature = "baseline")]
pub use method::{Method, Refined, Task, TaskView};
#[cfg(feature = "prior")]
pub use nalgebra;
pub use ndarray;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
