//! Cameras and warps.

pub mod random;
