//! Multi-view stereo on a CPU: several photographs of one scene become a depth hypothesis with a variance for each of them.

mod error;
pub mod poses;

pub use error::{Error, Result};
pub use {nalgebra, ndarray};
