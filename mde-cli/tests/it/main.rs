//! The program, run as processes, and the loop as a library.
#![allow(clippy::expect_used, clippy::unwrap_used, clippy::panic)]

mod library;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod processors;
mod refinement;
mod several;

#[cfg(feature = "program")]
mod capture;
#[cfg(feature = "program")]
mod cases;
#[cfg(feature = "program")]
mod common;
#[cfg(feature = "program")]
mod evaluation;
#[cfg(feature = "program")]
mod fixtures;
#[cfg(all(feature = "program", unix))]
mod kill;
#[cfg(all(feature = "program", feature = "onnx", unix))]
mod many;
#[cfg(feature = "program")]
mod outputs;
#[cfg(feature = "program")]
mod resources;
#[cfg(all(feature = "program", target_os = "linux"))]
mod surroundings;
#[cfg(feature = "program")]
mod terminal;
