//! Theorems of cameras, warps and reprojection.
#![allow(clippy::unwrap_used)]

mod camera;
mod reproject;
mod sampling;
mod support;
mod transfer;
mod warp;
