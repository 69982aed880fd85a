//! Depth-map files, photographs, disparity, and networks.
#![allow(clippy::unwrap_used)]

mod at_once;
mod formats;
#[cfg(feature = "onnx")]
mod graphs;
#[cfg(feature = "onnx")]
mod onnx;
mod photo;
mod priors;
#[cfg(feature = "onnx")]
mod profiles;

use std::path::{Path, PathBuf};

use mde_prior::ndarray::{Array2, Array3};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// A path in a folder that is removed with the first value.
fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

/// The image of tests/reference/make_models.py.
#[cfg(feature = "onnx")]
fn pattern(height: usize, width: usize) -> Array3<f32> {
    Array3::from_shape_fn((height, width, 3), |(y, x, c)| ((7 * y + 3 * x + 5 * c) % 32) as f32 / 31.0)
}

/// Weighted sum of the channels.
#[cfg_attr(not(feature = "onnx"), allow(dead_code))]
fn grey(image: &Array3<f32>, weights: [f32; 3]) -> Array2<f32> {
    Array2::from_shape_fn((image.dim().0, image.dim().1), |(y, x)| {
        (0..3).map(|c| weights[c] * image[[y, x, c]]).sum::<f32>()
    })
}

#[cfg_attr(not(feature = "onnx"), allow(dead_code))]
fn assert_close(a: &Array2<f32>, b: &Array2<f32>, tolerance: f32) {
    assert_eq!(a.dim(), b.dim());
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= tolerance, "they differ by {worst}");
}

/// The network of a fixture with the specification that is recognised.
#[cfg(feature = "onnx")]
fn recognised(name: &str) -> mde_prior::OnnxPrior {
    let (spec, _) = mde_prior::OnnxPrior::recognise(fixture(name)).unwrap();
    mde_prior::OnnxPrior::open(fixture(name), &spec).unwrap()
}
