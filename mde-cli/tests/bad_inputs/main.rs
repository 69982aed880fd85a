//! What is wrong is said in one line, with the value at fault and the remedy, and nothing is left; what is only odd works.
#![allow(clippy::unwrap_used)]

mod cameras;
mod captures;
#[path = "../common/mod.rs"]
mod common;
mod evaluations;
mod images;
mod inputs;
mod models;
mod outputs;
mod priors;
mod settings;
mod table;
mod usage;
