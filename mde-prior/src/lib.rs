#![cfg_attr(any(feature = "io", not(doctest)), doc = include_str!("../README.md"))]
//!
//! [`DisparityRule`] turns disparity of unknown scale and shift into positive depth, \\( 1/z = A \hat d + B \\), never
//! \\( 1/d \\); [`augment`] merges predictions of crops and mirror images into that of the whole image.

mod at_once;
pub mod augment;
mod error;
#[cfg(feature = "onnx")]
mod inference;
mod io;
mod prior;

pub use at_once::predict_each;
pub use augment::{AugmentationConfig, Augmented};
pub use error::{Error, Result};
#[cfg(feature = "onnxruntime")]
pub use inference::find_library as find_onnxruntime;
#[cfg(feature = "onnx")]
pub use inference::{OnnxPrior, RecognisedBy, Runtime};
pub use io::open::{self, FileKind};
pub use io::resample;
#[cfg(feature = "io")]
pub use io::{format, photo, pixels, write_atomic};
pub use ndarray;
#[cfg(feature = "io")]
pub use prior::FilePrior;
pub use prior::spec::{self, ModelSpec};
pub use prior::{
    Certainty, CertaintyMeaning, DepthKind, DepthPrior, DisparityRule, InferenceMemory, PriorDepth,
};
