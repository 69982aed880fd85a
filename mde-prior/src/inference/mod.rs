//! Networks that run in this process.

mod onnx;
mod runtime;

pub use onnx::OnnxPrior;
