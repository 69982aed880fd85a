#![doc = include_str!("../README.md")]

pub mod align;
#[cfg(feature = "baseline")]
pub mod baseline;
#[cfg(feature = "scenes")]
pub mod capture;
#[cfg(feature = "baseline")]
mod controls;
#[cfg(feature = "data")]
pub mod data;
mod error;
#[cfg(feature = "field")]
pub mod field;
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

#[cfg(feature = "baseline")]
pub use controls::{Controls, ScoredScene};
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
