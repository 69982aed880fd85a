//! Published models.

use super::spec::{Aspect, ModelSpec};
use crate::resample::Filter;
use crate::{DepthKind, Error, Result};
use std::path::Path;

/// Names of the profiles of [`ModelSpec::profile`].
pub const PROFILES: [&str; 16] = [
    "fastdepth",
    "midas-v2.1-small",
    "dpt-large",
    "dpt-hybrid",
    "depth-anything-v2",
    "depth-anything-v2-metric-indoor",
    "depth-anything-v2-metric-outdoor",
    "depth-anything-3-mono",
    "depth-anything-3-metric",
    "zoedepth",
    "depth-pro",
    "unidepth-v2",
    "moge-2",
    "metric3d-v2",
    "lite-mono",
    "pydnet",
];

/// Mean and standard deviation of the colours of ImageNet.
pub(crate) const IMAGENET: ([f32; 3], [f32; 3]) = ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
/// What processors of Transformers take where a file names none.
pub(super) const HALF: ([f32; 3], [f32; 3]) = ([0.5; 3], [0.5; 3]);

/// Names of Depth Pro's field of view: those of Transformers and of Apple's code.
#[cfg(feature = "onnx")]
pub(crate) const FIELDS_OF_VIEW: [&str; 2] = ["field_of_view", "fov_deg"];
/// Names of the inverse depth beside it.
#[cfg(feature = "onnx")]
pub(crate) const INVERSE_DEPTHS: [&str; 2] = ["predicted_depth", "canonical_inverse_depth"];

impl ModelSpec {
    /// The format of a published model, from its authors' own preprocessing.
    ///
    /// | profile | input | values | output |
    /// | --- | --- | --- | --- |
    /// | `fastdepth` | 224x224, squashed | RGB/255 | metres, floored at 0.1 |
    /// | `midas-v2.1-small` | within 256, multiples of 32 | ImageNet | disparity |
    /// | `dpt-large`, `dpt-hybrid` | about 384, multiples of 32 | mean and std 0.5 | disparity |
    /// | `depth-anything-v2` | 518 at least, multiples of 14 | ImageNet | disparity |
    /// | `depth-anything-v2-metric-indoor`, `-outdoor` | the same | ImageNet | metres |
    /// | `depth-anything-3-mono` | within 504, multiples of 14 | ImageNet | depth without scale |
    /// | `depth-anything-3-metric` | the same | ImageNet | metres for a focal length of 300 pixels |
    /// | `zoedepth` | 512x384 at least, multiples of 32 | mean and std 0.5 | metres |
    /// | `depth-pro` | 1536x1536, squashed | mean and std 0.5 | metres and `focallength_px`, or inverse depth of a focal length of the width and `field_of_view` |
    /// | `unidepth-v2` | 630x462, squashed | ImageNet | metres: z of `pts_3d`; `intrinsics`; `confidence`, which is its error |
    /// | `moge-2` | within 728, multiples of 14, 1800 tokens | RGB/255 | metres: z of `points`, its shift recovered, times `metric_scale`; `mask`; the camera |
    /// | `metric3d-v2` | 1064x616, aspect kept, padded | RGB | metres for a focal length of 1000 pixels |
    /// | `lite-mono`, `pydnet` | 640x192, squashed | RGB/255 | disparity |
    ///
    /// # Errors
    /// [`Error::UnknownProfile`] with the known names.
    pub fn profile(name: &str) -> Result<Self> {
        let kept = |side, aspect, multiple_of, (mean, std), output| Self {
            aspect,
            multiple_of,
            input_filter: Filter::Bicubic,
            mean,
            std,
            ..Self::new(side, side, output)
        };
        let disparity = DepthKind::AffineDisparity;
        let anything = |output| Self {
            output_filter: Filter::BilinearAlignCorners,
            ..kept(518, Aspect::KeepLowerBound, 14, IMAGENET, output)
        };
        let squashed =
            |width, height, (mean, std), output| Self { mean, std, ..Self::new(width, height, output) };
        match name {
            "fastdepth" => Ok(Self { output_floor: Some(0.1), ..Self::new(224, 224, DepthKind::Metric) }),
            "midas-v2.1-small" => Ok(Self {
                output_filter: Filter::Bicubic,
                ..kept(256, Aspect::KeepUpperBound, 32, IMAGENET, disparity)
            }),
            "dpt-large" | "dpt-hybrid" => Ok(Self {
                output_filter: Filter::Bicubic,
                ..kept(384, Aspect::KeepMinimal, 32, HALF, disparity)
            }),
            "depth-anything-v2" => Ok(anything(disparity)),
            "depth-anything-v2-metric-indoor" | "depth-anything-v2-metric-outdoor" => {
                Ok(anything(DepthKind::Metric))
            }
            "depth-anything-3-mono" => {
                Ok(kept(504, Aspect::KeepUpperBound, 14, IMAGENET, DepthKind::RelativeDepth))
            }
            "depth-anything-3-metric" => Ok(Self {
                canonical_focal: Some(300.0),
                ..kept(504, Aspect::KeepUpperBound, 14, IMAGENET, DepthKind::Metric)
            }),
            "zoedepth" => Ok(Self {
                width: 512,
                input_filter: Filter::Bilinear,
                ..kept(384, Aspect::KeepLowerBound, 32, HALF, DepthKind::Metric)
            }),
            "depth-pro" => Ok(Self {
                camera_output: Some("focallength_px".to_owned()),
                ..squashed(1536, 1536, HALF, DepthKind::Metric)
            }),
            "unidepth-v2" => Ok(Self {
                output_name: Some("pts_3d".to_owned()),
                output_channel: Some(2),
                camera_output: Some("intrinsics".to_owned()),
                // Its name misleads: the loss fits it to the error (unidepth/ops/losses/confidence.py).
                error_output: Some("confidence".to_owned()),
                ..squashed(630, 462, IMAGENET, DepthKind::Metric)
            }),
            "moge-2" => Ok(Self {
                input_filter: Filter::BilinearAntialias,
                output_name: Some("points".to_owned()),
                output_channel: Some(2),
                scale_output: Some("metric_scale".to_owned()),
                mask_output: Some("mask".to_owned()),
                recover_shift: true,
                tokens: Some(1800),
                ..kept(728, Aspect::KeepUpperBound, 14, ([0.0; 3], [1.0; 3]), DepthKind::Metric)
            }),
            // Its export subtracts mean and standard deviation itself, of values up to 255.
            "metric3d-v2" => Ok(Self {
                height: 616,
                input_filter: Filter::Bilinear,
                canonical_focal: Some(1000.0),
                ..kept(1064, Aspect::Pad, 1, ([0.0; 3], [1.0 / 255.0; 3]), DepthKind::Metric)
            }),
            "lite-mono" | "pydnet" => Ok(Self::new(640, 192, disparity)),
            _ => Err(Error::UnknownProfile { name: name.to_owned() }),
        }
    }

    /// The specification for a graph with those outputs, where a network has exports of several kinds.
    #[cfg(feature = "onnx")]
    pub(crate) fn for_outputs(self, outputs: &[String]) -> Self {
        let has = |name: &str| outputs.iter().any(|output| output == name);
        let lacks = |name: &Option<String>, of: &str| name.as_deref() == Some(of) && !has(of);
        let named = |name: &str| Some(name.to_owned());
        // Depth Pro as its network gives it, without the metres that its authors' code makes of it.
        if lacks(&self.camera_output, "focallength_px") {
            let fov = FIELDS_OF_VIEW.into_iter().find(|name| has(name));
            let depth = INVERSE_DEPTHS.into_iter().find(|name| has(name));
            if let (Some(fov), Some(depth)) = (fov, depth) {
                return Self {
                    camera_output: None,
                    fov_output: named(fov),
                    output_name: named(depth),
                    ..self
                };
            }
        }
        // UniDepth V2's older export.
        if lacks(&self.output_name, "pts_3d") && has("out_K") && has("depth") {
            let (output_name, camera_output) = (named("depth"), named("out_K"));
            return Self { output_name, camera_output, output_channel: None, ..self };
        }
        self
    }

    /// The profile that matches a model's file name: `dpt_large_384.onnx`, `depth_anything_v2_vits.onnx`, ...
    ///
    /// # Errors
    /// [`Error::UnknownProfile`] when none does.
    pub fn guess(model: impl AsRef<Path>) -> Result<Self> {
        let file = model.as_ref().file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let plain: String = file.chars().filter(char::is_ascii_alphanumeric).collect();
        let has = |part: &str| plain.contains(part);
        let name = if has("fastdepth") {
            "fastdepth"
        } else if has("midas") && (has("small") || has("v21s")) {
            "midas-v2.1-small"
        } else if has("dptlarge") {
            "dpt-large"
        } else if has("dpthybrid") {
            "dpt-hybrid"
        } else if has("depthanythingv2") && has("metric") {
            // Metres either way, but the ranges of rooms and streets differ.
            if has("outdoor") || has("vkitti") {
                "depth-anything-v2-metric-outdoor"
            } else {
                "depth-anything-v2-metric-indoor"
            }
        } else if has("depthanythingv2") {
            "depth-anything-v2"
        } else if (has("depthanything3") || has("da3")) && has("metric") {
            "depth-anything-3-metric"
        } else if (has("depthanything3") || has("da3")) && has("mono") {
            "depth-anything-3-mono"
        } else if has("zoedepth") {
            "zoedepth"
        } else if has("depthpro") {
            "depth-pro"
        } else if has("unidepthv2") {
            "unidepth-v2"
        } else if has("moge2") {
            "moge-2"
        } else if has("metric3d") {
            "metric3d-v2"
        } else if has("litemono") {
            "lite-mono"
        } else if has("pydnet") && !has("upydnet") {
            "pydnet"
        } else {
            return Err(Error::UnknownProfile { name: file });
        };
        Self::profile(name)
    }
}
