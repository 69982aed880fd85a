//! Input and output format of a model: a small TOML file beside the model, or a named profile.

use mde_uncertainty::OutOfRange;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::resample::Filter;
use crate::{DepthKind, Error, FileKind, PriorDepth, Result, open};

pub use super::profiles::PROFILES;

/// How an image is brought to the model's input size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Aspect {
    /// To exactly `width` x `height`.
    #[default]
    Squash,
    /// Aspect kept, both sides multiples of `multiple-of`, neither below `width` x `height` (Depth Anything).
    KeepLowerBound,
    /// Aspect kept, both sides multiples of `multiple-of`, neither above `width` x `height` (MiDaS small).
    KeepUpperBound,
    /// Aspect kept, both sides multiples of `multiple-of`, scaled as little as possible (DPT).
    KeepMinimal,
    /// To `width` x `height` with the aspect kept: scaled to fit and padded on two sides with the mean colour of ImageNet; the padding is cut
    /// from the outputs (Metric3D).
    Pad,
}

/// Order of the input's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// `[1, 3, height, width]`.
    #[default]
    Nchw,
    /// `[1, height, width, 3]`.
    Nhwc,
}

/// Order of the colour channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Channels {
    /// Red first.
    #[default]
    Rgb,
    /// Blue first.
    Bgr,
}

/// Input and output format of a model. In a TOML file `output` must be stated; the rest has defaults (224x224, squashed, RGB/255).
///
/// ```
/// use mde_prior::spec::{Aspect, ModelSpec};
///
/// let spec = ModelSpec::from_toml("width = 518\nheight = 518\naspect = 'keep-lower-bound'\n\
///                                  multiple-of = 14\noutput = 'disparity'\n")?;
/// assert_eq!(spec.aspect, Aspect::KeepLowerBound);
/// assert_eq!(spec.input_size(480, 640), (518, 686));
/// # Ok::<(), mde_prior::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ModelSpec {
    /// Nominal input width in pixels.
    #[serde(default = "side")]
    pub width: usize,
    /// Nominal input height in pixels.
    #[serde(default = "side")]
    pub height: usize,
    /// How the image is brought to the input size. A model with a fixed input size takes that size in any case, squashed unless padded.
    #[serde(default)]
    pub aspect: Aspect,
    /// Both input sides are multiples of this when the aspect is kept.
    #[serde(default = "one")]
    pub multiple_of: usize,
    /// Filter from image to input.
    #[serde(default)]
    pub input_filter: Filter,
    /// Subtracted from each channel (red, green, blue) of values in `[0, 1]`.
    #[serde(default)]
    pub mean: [f32; 3],
    /// Then divided by this.
    #[serde(default = "ones")]
    pub std: [f32; 3],
    /// Order of the input's axes.
    #[serde(default)]
    pub layout: Layout,
    /// Order of the colour channels.
    #[serde(default)]
    pub channels: Channels,
    /// The meaning of the output.
    pub output: DepthKind,
    /// Name of the output, for models that have several; the first otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_name: Option<String>,
    /// Index of the depth among the channels of an output of points, `[1, height, width, 3]` or `[1, 3, height, width]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_channel: Option<usize>,
    /// Name of an output by whose number the depth is multiplied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_output: Option<String>,
    /// Name of an output that is above 1/2 where the depth is valid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_output: Option<String>,
    /// Name of an output with the camera, in pixels of the input: a focal length, or a 3x3 matrix.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_output: Option<String>,
    /// Name of an output with the camera's horizontal field of view in degrees. The depth's output \\(c\\) is then inverse depth for a focal
    /// length of the width, and depth is \\(1 / (2 c \tan(\text{fov} / 2))\\), from 0.1 mm to 10 km (Depth Pro).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov_output: Option<String>,
    /// Name of an output with the model's confidence per pixel, larger where it is surer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence_output: Option<String>,
    /// Name of an output with the model's own estimate of its error per pixel, larger where it is less sure, in place of a confidence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error_output: Option<String>,
    /// Focal length \\(f_c\\) in pixels of the camera for which the output is in metres: for another camera, of \\(f\\) pixels at the
    /// size of the input, metres are \\(f / f_c\\) times the output, and without a known camera the depth has no unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub canonical_focal: Option<f32>,
    /// Whether the points' depth lacks an unknown shift, which is found from their rays before the scale is applied (MoGe).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub recover_shift: bool,
    /// The number for the inputs other than the image (MoGe's `num_tokens`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tokens: Option<u32>,
    /// Smallest depth, for models whose depth can reach 0; not for disparity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_floor: Option<f32>,
    /// Filter from output to image.
    #[serde(default)]
    pub output_filter: Filter,
}

fn side() -> usize {
    224
}
fn one() -> usize {
    1
}
fn ones() -> [f32; 3] {
    [1.0; 3]
}

impl ModelSpec {
    /// A model that takes RGB/255 squashed to `width` x `height` and gives `output`.
    #[must_use]
    pub fn new(width: usize, height: usize, output: DepthKind) -> Self {
        Self {
            width,
            height,
            aspect: Aspect::Squash,
            multiple_of: 1,
            input_filter: Filter::Bilinear,
            mean: [0.0; 3],
            std: [1.0; 3],
            layout: Layout::Nchw,
            channels: Channels::Rgb,
            output,
            output_name: None,
            output_channel: None,
            scale_output: None,
            mask_output: None,
            camera_output: None,
            fov_output: None,
            confidence_output: None,
            error_output: None,
            canonical_focal: None,
            recover_shift: false,
            tokens: None,
            output_floor: None,
            output_filter: Filter::Bilinear,
        }
    }

    /// The same model with an output of that kind, without what only the kind before it had.
    #[must_use]
    pub fn with_output(self, output: DepthKind) -> Self {
        Self {
            output,
            output_floor: self.output_floor.filter(|_| output.is_depth()),
            canonical_focal: self.canonical_focal.filter(|_| output == DepthKind::Metric),
            fov_output: self.fov_output.filter(|_| output.is_depth()),
            ..self
        }
    }

    /// Reads a specification in TOML.
    ///
    /// # Errors
    /// [`Error::Input`] when it can't be parsed, [`Error::Config`] when a value is out of range.
    pub fn from_toml(text: &str) -> Result<Self> {
        let spec: Self = toml::from_str(text).map_err(|e| Error::Input(one_line(&e)))?;
        spec.validate()?;
        Ok(spec)
    }

    /// The specification in `MODEL.toml` next to `MODEL.onnx`, if there is such a file.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Malformed`] that names the TOML file.
    pub fn beside(model: impl AsRef<Path>) -> Result<Option<Self>> {
        let path = model.as_ref().with_extension("toml");
        let Some(text) = text_of(&path)? else { return Ok(None) };
        Self::from_toml(&text).map(Some).map_err(|e| Error::malformed(&path, e.to_string()))
    }

    /// Checks the values.
    ///
    /// # Errors
    /// [`Error::Config`] that names the field.
    pub fn validate(&self) -> Result<()> {
        let check = OutOfRange::check;
        for (field, side) in [("width", self.width), ("height", self.height)] {
            check((1..=8192).contains(&side), field, &side, "give an input size of 1 to 8192 pixels")?;
        }
        let multiple = self.multiple_of;
        let fits = (1..=self.width.min(self.height)).contains(&multiple);
        check(fits, "multiple-of", &multiple, "give 1 to the smaller side of the input")?;
        for mean in self.mean {
            check(mean.is_finite(), "mean", &mean, "give finite values")?;
        }
        for std in self.std {
            check(std.is_finite() && std != 0.0, "std", &std, "give finite values other than 0")?;
        }
        if let Some(floor) = self.output_floor {
            check(floor.is_finite() && floor > 0.0, "output-floor", &floor, "give a positive depth")?;
            check(self.output.is_depth(), "output-floor", &floor, "remove it: disparities may be negative")?;
        }
        if let Some(name) = &self.fov_output {
            check(self.output.is_depth(), "fov-output", name, "set output = \"metric\", or remove it")?;
        }
        if let (Some(name), Some(_)) = (&self.error_output, &self.confidence_output) {
            check(false, "error-output", name, "remove it or confidence-output: one of them is kept")?;
        }
        if let Some(focal) = self.canonical_focal {
            let positive = focal.is_finite() && focal > 0.0;
            check(positive, "canonical-focal", &focal, "give a positive number of pixels")?;
            let metric = self.output == DepthKind::Metric;
            check(metric, "canonical-focal", &focal, "set output = \"metric\", or remove it")?;
        }
        Ok(())
    }

    /// The keys and names of the outputs beside the depth.
    #[cfg(feature = "onnx")]
    pub(crate) fn further_outputs(&self) -> [(&'static str, Option<&String>); 6] {
        [
            ("scale-output", self.scale_output.as_ref()),
            ("mask-output", self.mask_output.as_ref()),
            ("camera-output", self.camera_output.as_ref()),
            ("fov-output", self.fov_output.as_ref()),
            ("confidence-output", self.confidence_output.as_ref()),
            ("error-output", self.error_output.as_ref()),
        ]
    }

    /// A prediction in metres, where the model has a [canonical focal length](Self::canonical_focal) \\(f_c\\): times \\(f / f_c\\) for
    /// photographs of the focal length `focal` / their width, which the model takes at `input` (by default as they are). The mean of
    /// both axes, as the input's pixels need not be square.
    #[must_use]
    pub fn in_metres(&self, prediction: PriorDepth, focal: f64, input: Option<(usize, usize)>) -> PriorDepth {
        let Some(canonical) = self.canonical_focal else { return prediction };
        let image = prediction.map.dim();
        let input = input.unwrap_or(image);
        let aspect = image.1 as f64 / image.0.max(1) as f64;
        let at_input = focal * (input.1 as f64 * aspect * input.0 as f64).sqrt();
        let factor = (at_input / f64::from(canonical)) as f32;
        PriorDepth { map: prediction.map.mapv_into(|z| factor * z), kind: self.output, ..prediction }
    }

    /// `(height, width)` of the input for an image of that size; with [`Aspect::Pad`] that of the image within the input.
    ///
    /// With the aspect kept, both sides are scaled by one factor (the larger, the smaller, or the one nearer to 1 of
    /// input side / image side) and rounded to multiples, as MiDaS does.
    #[must_use]
    pub fn input_size(&self, height: usize, width: usize) -> (usize, usize) {
        let (y, x) = (self.height as f64 / height.max(1) as f64, self.width as f64 / width.max(1) as f64);
        let scale = match self.aspect {
            Aspect::Squash => return (self.height, self.width),
            Aspect::KeepLowerBound => y.max(x),
            Aspect::KeepUpperBound | Aspect::Pad => y.min(x),
            Aspect::KeepMinimal if (1.0 - x).abs() < (1.0 - y).abs() => x,
            Aspect::KeepMinimal => y,
        };
        let side = |image: usize, bound: usize| {
            let (exact, step) = (scale * image as f64, self.multiple_of.max(1) as f64);
            if self.aspect == Aspect::Pad {
                return (exact.round_ties_even() as usize).clamp(1, bound.max(1));
            }
            let nearest = (exact / step).round_ties_even() * step;
            let fitted = match self.aspect {
                Aspect::KeepLowerBound if nearest < bound as f64 => (exact / step).ceil() * step,
                Aspect::KeepUpperBound if nearest > bound as f64 => (exact / step).floor() * step,
                _ => nearest,
            };
            fitted.max(step) as usize
        };
        (side(height, self.height), side(width, self.width))
    }
}

/// The text of a file of settings, if there is one.
pub(super) fn text_of(path: &Path) -> Result<Option<String>> {
    match open::read_text(path, FileKind::Settings) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        text => text.map(Some).map_err(|e| Error::read(path, e)),
    }
}

/// TOML's error, which has several lines, in one line.
fn one_line(error: &toml::de::Error) -> String {
    error.to_string().lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" ")
}
