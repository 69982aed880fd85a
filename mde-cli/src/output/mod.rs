//! The files of a result.

#[cfg(feature = "files")]
mod canvas;
#[cfg(feature = "files")]
pub mod every;
#[cfg(feature = "files")]
pub mod export;
#[cfg(feature = "files")]
pub mod files;
#[cfg(feature = "files")]
pub mod folder;
#[cfg(feature = "files")]
pub mod names;
#[cfg(feature = "files")]
pub mod preview;
pub mod record;
