//! Files: how they are opened, depth maps, photographs, atomic writes. Opening and resampling need no feature.

#[cfg(feature = "io")]
mod atomic;
#[cfg(feature = "io")]
pub mod format;
pub mod open;
#[cfg(feature = "io")]
pub mod photo;
#[cfg(feature = "io")]
pub mod pixels;
pub mod resample;

#[cfg(feature = "io")]
pub use atomic::write_atomic;
