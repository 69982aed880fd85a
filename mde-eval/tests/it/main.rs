//! What the metrics, rooms, data sets and baselines promise, from outside.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod baseline;
mod data;
mod reference;
mod scene;
mod score;
