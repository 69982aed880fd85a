//! The files of a result.

mod canvas;
pub mod every;
pub mod export;
pub mod files;
pub mod folder;
pub mod names;
pub mod preview;
pub mod record;
