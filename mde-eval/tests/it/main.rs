//! What the metrics, rooms, data sets and baselines promise, from outside.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod baseline;
mod data;
mod reference;
mod scene;
mod score;

use mde_eval::ndarray::Array2;

/// A map of a reference, which lists its rows.
fn map(value: &serde_json::Value) -> Array2<f32> {
    let rows: Vec<Vec<f64>> = serde_json::from_value(value.clone()).unwrap();
    Array2::from_shape_fn((rows.len(), rows[0].len()), |(y, x)| rows[y][x] as f32)
}
