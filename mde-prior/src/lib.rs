//! Monocular depth priors, test-time augmentation, and the depth-map file formats of the workspace.
//!
//! The refinement starts from the depth that a monocular network predicts for one photograph, the paper's \\( D_o \\) (Eq. 16).
//! Such a prior is a [`DepthPrior`]: a file that some network wrote (`FilePrior`), a network in an ONNX file that
//! runs here (`OnnxPrior`), or a type of your own. Its prediction is a [`PriorDepth`], with the meaning of its values
//! ([`DepthKind`]). [`DisparityRule`] turns disparity of unknown scale and shift into positive depth,
//! \\( 1/z = A \hat d + B \\), never \\( 1/d \\). [`augment`] merges predictions of crops and mirror images into that of the whole
//! image. Depth is z along the optical axis; 0 means missing; NaN is refused or becomes missing.
//!
//! | module | contents | feature |
//! | --- | --- | --- |
//! | the root, [`spec`] | the trait, predictions of one image or [of several side by side](predict_each), the disparity rule, descriptions of models | |
//! | [`augment`] | test-time augmentation | |
//! | [`resample`] | resizing of maps | |
//! | [`open`] | regular files of a bounded size | |
//! | `format`, `photo` | depth-map files and photographs | `io` (default) |
//! | `OnnxPrior` | networks in ONNX files, run by tract | `onnx` |
//! | `Runtime`, `find_onnxruntime` | ONNX Runtime in the place of tract | `onnxruntime` |
#![cfg_attr(
    feature = "io",
    doc = r#"
```
use mde_prior::ndarray::{Array3, array};
use mde_prior::{DepthKind, DepthPrior, DisparityRule, FilePrior, format};

let folder = tempfile::tempdir()?;
let path = folder.path().join("disparity.npy");
format::write_npy(&path, array![[-1.0_f32, 0.0, 1.0], [2.0, 3.0, 4.0]].view())?;

let prior = FilePrior::open(&path, DepthKind::AffineDisparity, &Default::default())?;
let image = Array3::<f32>::zeros((2, 3, 3));
let depth = prior.predict(image.view())?.to_depth(&DisparityRule::default())?;
assert!(depth.iter().all(|z| (0.8..=8.0).contains(z)));
assert!(depth[[0, 0]] > depth[[1, 2]]);
# Ok::<(), Box<dyn std::error::Error>>(())
```
"#
)]

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
pub use io::{format, photo, write_atomic};
pub use ndarray;
#[cfg(feature = "io")]
pub use prior::FilePrior;
pub use prior::spec::{self, ModelSpec};
pub use prior::{
    Certainty, CertaintyMeaning, DepthKind, DepthPrior, DisparityRule, InferenceMemory, PriorDepth,
};

#[cfg(all(doctest, feature = "io"))]
#[doc = include_str!("../README.md")]
struct Readme;
