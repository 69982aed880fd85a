//! Depth-map files, photographs, atomic writes, and resampling, which needs no feature.

#[cfg(feature = "io")]
mod atomic;
#[cfg(feature = "io")]
pub mod format;
#[cfg(feature = "io")]
mod jpeg;
#[cfg(feature = "io")]
mod limits;
#[cfg(feature = "io")]
pub mod photo;
pub mod resample;

#[cfg(feature = "io")]
pub use atomic::write_atomic;
