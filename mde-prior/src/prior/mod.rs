//! The prior's interface, its predictions, and the description of a model.

mod disparity;
#[cfg(feature = "io")]
mod file;
mod hub;
mod profiles;
pub mod spec;

use mde_uncertainty::OutOfRange;
use ndarray::{Array2, ArrayView3, Zip};
use serde::{Deserialize, Serialize};

use crate::error::same_size;
use crate::resample::nearest;
use crate::{Error, Result};

pub use disparity::DisparityRule;
#[cfg(feature = "io")]
pub use file::FilePrior;
#[cfg(feature = "onnx")]
pub(crate) use profiles::{FIELDS_OF_VIEW, IMAGENET, INVERSE_DEPTHS};

/// A monocular depth estimator; pipelines take `&dyn DepthPrior`.
pub trait DepthPrior: Sync {
    /// Predicts the depth of `image`, `[height, width, 3]`, sRGB values in `[0, 1]`; the result has the image's size.
    ///
    /// # Errors
    /// The reason why there is no prediction: a file of another size, a model that fails, or [`Error::External`] with the
    /// implementation's own error.
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth>;

    /// Whether it can predict any image, crops and mirror images among them: a network can, a map from a file cannot. `false`
    /// unless overridden; [`augment`](crate::augment) needs `true`.
    fn accepts_new_images(&self) -> bool {
        false
    }

    /// `(height, width)` to which an image of that size is brought before it is predicted; `None`, the default, where there is
    /// no such size. A crop shows the model more only where the image has more pixels; see [`augment`](crate::augment).
    fn resolution(&self, _height: usize, _width: usize) -> Option<(usize, usize)> {
        None
    }

    /// Number of predictions that may run at once; 1, the default, for a model that uses all cores itself or that only one thread may
    /// use. A prediction may use the threads of rayon's current pool that have none of their own.
    fn concurrency(&self) -> usize {
        1
    }

    /// Memory for images of that size; `None`, the default, where it is not known.
    fn memory(&self, _height: usize, _width: usize) -> Option<InferenceMemory> {
        None
    }
}

/// Memory that a network takes, an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InferenceMemory {
    /// Bytes of the loaded network, however many predictions there are.
    pub model: u64,
    /// Bytes of each of the predictions at once.
    pub prediction: u64,
}

/// The meaning of a prediction's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum DepthKind {
    /// Depth z in metres.
    #[serde(rename = "metric")]
    Metric,
    /// Depth z in an unknown unit.
    #[serde(rename = "depth")]
    RelativeDepth,
    /// `d` with \\( 1/z = a d + b \\), `a > 0` and `b` unknown (MiDaS, DPT, Depth Anything); it may be negative.
    #[serde(rename = "disparity")]
    AffineDisparity,
}

impl DepthKind {
    /// Whether the map holds depth, that is whether 0 and below mean "missing".
    #[must_use]
    pub fn is_depth(self) -> bool {
        !matches!(self, Self::AffineDisparity)
    }
}

impl std::fmt::Display for DepthKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.serialize(f)
    }
}

impl std::str::FromStr for DepthKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let mut kinds = [Self::Metric, Self::RelativeDepth, Self::AffineDisparity].into_iter();
        kinds.find(|kind| kind.to_string() == name).ok_or_else(|| {
            OutOfRange::new("kind", format!("{name:?}"), "give metric, depth or disparity").into()
        })
    }
}

/// The prediction for one image.
#[derive(Debug, Clone, PartialEq)]
pub struct PriorDepth {
    /// `[height, width]`, the values of the model or file; 0 where `valid` is false.
    pub map: Array2<f32>,
    /// `[height, width]`, whether the pixel has a value.
    pub valid: Array2<bool>,
    /// The meaning of the values.
    pub kind: DepthKind,
    /// \\((f_x, f_y, c_x, c_y)\\) in pixels of the image, with pixel centres at integers, where the model estimates its camera.
    pub intrinsics: Option<[f64; 4]>,
    /// How sure the model itself is of each pixel, where it says so.
    pub certainty: Option<Certainty>,
}

/// How sure a model is of each pixel, by its own statement, which is not calibrated.
#[derive(Debug, Clone, PartialEq)]
pub struct Certainty {
    /// The meaning of the values.
    pub meaning: CertaintyMeaning,
    /// `[height, width]`, without a unit.
    pub map: Array2<f32>,
}

/// The meaning of a model's statement about its own errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum CertaintyMeaning {
    /// Larger is surer.
    Confidence,
    /// Larger is less sure: the model's estimate of its error.
    Error,
}

impl CertaintyMeaning {
    /// `confidence` or `error`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Confidence => "confidence",
            Self::Error => "error",
        }
    }
}

impl PriorDepth {
    /// A map in which values that are not finite, and for depths those that are not positive, are missing.
    ///
    /// # Errors
    /// [`Error::Empty`] when no pixel has a value.
    pub fn from_values(map: Array2<f32>, kind: DepthKind) -> Result<Self> {
        let valid = Array2::from_elem(map.dim(), true);
        Self::with_mask(map, valid, kind)
    }

    /// A map with a mask of the pixels that have a value, both `[height, width]`. A value that means "missing" is masked out too.
    ///
    /// # Errors
    /// [`Error::Input`] when the shapes differ, [`Error::Empty`] when no pixel has a value.
    pub fn with_mask(mut map: Array2<f32>, mut valid: Array2<bool>, kind: DepthKind) -> Result<Self> {
        same_size(("the prior's map", map.dim()), ("its mask", valid.dim()))?;
        Zip::from(&mut map).and(&mut valid).for_each(|value, valid| {
            *valid &= value.is_finite() && (*value > 0.0 || !kind.is_depth());
            if !*valid {
                *value = 0.0;
            }
        });
        if !valid.iter().any(|&v| v) {
            let (height, width) = map.dim();
            return Err(Error::Empty(format!(
                "the prior ({kind}, {width}x{height}) has no usable pixel; check the file or the kind given"
            )));
        }
        Ok(Self { map, valid, kind, intrinsics: None, certainty: None })
    }

    /// Positive depth, `[height, width]`, 0 = missing: depths unchanged (metres, or the model's unit), disparity through `rule`.
    ///
    /// # Errors
    /// Those of [`DisparityRule::depth`].
    pub fn to_depth(&self, rule: &DisparityRule) -> Result<Array2<f32>> {
        let checked = Self::with_mask(self.map.clone(), self.valid.clone(), self.kind)?;
        if checked.kind.is_depth() {
            return Ok(checked.map);
        }
        rule.depth(checked.map.view(), checked.valid.view())
    }

    /// The map and its mask at another `(height, width)`, each pixel the nearest one.
    ///
    /// # Errors
    /// [`Error::Input`] when no pixel keeps a value.
    pub fn resized(&self, size: (usize, usize)) -> Result<Self> {
        Self::with_mask(nearest(self.map.view(), size), nearest(self.valid.view(), size), self.kind)
    }
}
