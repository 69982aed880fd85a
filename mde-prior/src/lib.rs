//! Monocular depth priors, and every depth-map file format of the workspace.
//!
//! The refinement starts from the depth that a monocular network sees in one photograph, the paper's \\( D_o \\) (Eq. 16).
//! Here such a prior is a [`DepthPrior`]: a file that some network wrote ([`FilePrior`]), a network in an ONNX file that
//! runs here (`OnnxPrior`, feature `onnx`), or your own type. Its prediction, a [`PriorDepth`], states the meaning of its values
//! ([`DepthKind`]), and [`DisparityRule`] turns disparity with unknown scale and shift into positive depth,
//! \\( 1/z = A \hat d + B \\), never \\( 1/d \\). [`format`](mod@format) reads and writes depth maps, [`photo`] photographs.
//! Depth is z along the optical axis; 0 means missing; NaN never gets out.
//!
//! ```
//! use mde_prior::ndarray::{Array3, array};
//! use mde_prior::{DepthKind, DepthPrior, DisparityRule, FilePrior, format};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("disparity.npy");
//! format::write_npy(&path, array![[-1.0_f32, 0.0, 1.0], [2.0, 3.0, 4.0]].view())?;
//!
//! let prior = FilePrior::open(&path, DepthKind::AffineDisparity, None)?;
//! let image = Array3::<f32>::zeros((2, 3, 3));
//! let depth = prior.predict(image.view())?.to_depth(&DisparityRule::default())?;
//! assert!(depth.iter().all(|z| (0.8..=8.0).contains(z)));
//! assert!(depth[[0, 0]] > depth[[1, 2]]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic;
pub mod augment;
mod disparity;
mod error;
mod file;
pub mod filter;
pub mod format;
#[cfg(feature = "onnx")]
mod onnx;
pub mod photo;
mod prior;
pub mod resample;
pub mod spec;

pub use atomic::write_atomic;
pub use augment::{AugmentationConfig, Augmented};
pub use disparity::DisparityRule;
pub use error::{Error, Result};
pub use file::FilePrior;
pub use ndarray;
#[cfg(feature = "onnx")]
pub use onnx::OnnxPrior;
pub use prior::{DepthKind, DepthPrior, PriorDepth};
pub use spec::ModelSpec;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
