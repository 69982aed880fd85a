//! Unusable input gives one line with the value at fault and the remedy, and leaves no files; unusual input works.
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
