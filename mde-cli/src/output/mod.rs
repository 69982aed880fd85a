//! The files of a result.

#[cfg(feature = "files")]
pub mod canvas;
#[cfg(feature = "files")]
pub mod every;
#[cfg(feature = "files")]
pub mod exchange;
#[cfg(feature = "files")]
pub mod export;
#[cfg(feature = "files")]
pub mod maps;
#[cfg(feature = "files")]
pub mod names;
#[cfg(feature = "files")]
pub mod preview;
pub mod record;
