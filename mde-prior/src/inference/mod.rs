//! Networks that run in this process.

mod graph;
mod guard;
mod onnx;
#[cfg(feature = "onnxruntime")]
mod onnxruntime;
mod outline;
mod points;
mod rewrite;
mod runtime;
mod tract;

pub use onnx::{OnnxPrior, RecognisedBy, Runtime};
#[cfg(feature = "onnxruntime")]
pub use onnxruntime::find_library;
