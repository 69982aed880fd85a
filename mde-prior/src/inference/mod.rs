//! Networks that run in this process.

mod onnx;

pub use onnx::OnnxPrior;
