//! Published models.

use super::spec::{Aspect, ModelSpec};
use crate::DepthKind::{self, AffineDisparity, Metric, RelativeDepth};
use crate::resample::Filter;
use crate::{Error, Result};
use Aspect::{KeepLowerBound, KeepMinimal, KeepUpperBound, Pad, Squash};
use Filter::{Bicubic, Bilinear, BilinearAlignCorners, BilinearAntialias};
use std::path::Path;

/// Names of the profiles of [`ModelSpec::profile`].
pub const PROFILES: [&str; ROWS.len()] = {
    let mut names = [""; ROWS.len()];
    let mut row = 0;
    while row < names.len() {
        names[row] = ROWS[row].0;
        row += 1;
    }
    names
};

/// Letters and digits that a file's name has, and the profile; the first row that fits. A file with its profile's name needs none.
const NAMES: [(&[&str], &str); 10] = [
    (&["midas", "small"], "midas-v2.1-small"),
    (&["midas", "v21s"], "midas-v2.1-small"),
    // Metres either way, but the ranges of rooms and streets differ.
    (&["depthanythingv2", "metric", "outdoor"], "depth-anything-v2-metric-outdoor"),
    (&["depthanythingv2", "metric", "vkitti"], "depth-anything-v2-metric-outdoor"),
    (&["depthanythingv2", "metric"], "depth-anything-v2-metric-indoor"),
    (&["depthanything3", "metric"], "depth-anything-3-metric"),
    (&["da3", "metric"], "depth-anything-3-metric"),
    (&["depthanything3", "mono"], "depth-anything-3-mono"),
    (&["da3", "mono"], "depth-anything-3-mono"),
    (&["metric3d"], "metric3d-v2"),
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

/// No change of colours.
const PLAIN: Colours = ([0.0; 3], [1.0; 3]);
/// Colours up to 255, of which the network subtracts mean and standard deviation itself.
const BYTES: Colours = ([0.0; 3], [1.0 / 255.0; 3]);

type Colours = ([f32; 3], [f32; 3]);
/// Name; mean and standard deviation; width, height, multiple; meaning, aspect; filters in and out; floor and canonical focal length.
type Row = (&'static str, Colours, [usize; 3], DepthKind, Aspect, [Filter; 2], [Option<f32>; 2]);

#[rustfmt::skip]
const ROWS: [Row; 16] = [
    ("fastdepth", PLAIN, [224, 224, 1], Metric, Squash, [Bilinear, Bilinear], [Some(0.1), None]),
    ("midas-v2.1-small", IMAGENET, [256, 256, 32], AffineDisparity, KeepUpperBound, [Bicubic, Bicubic], [None, None]),
    ("dpt-large", HALF, [384, 384, 32], AffineDisparity, KeepMinimal, [Bicubic, Bicubic], [None, None]),
    ("dpt-hybrid", HALF, [384, 384, 32], AffineDisparity, KeepMinimal, [Bicubic, Bicubic], [None, None]),
    ("depth-anything-v2", IMAGENET, [518, 518, 14], AffineDisparity, KeepLowerBound, [Bicubic, BilinearAlignCorners], [None, None]),
    ("depth-anything-v2-metric-indoor", IMAGENET, [518, 518, 14], Metric, KeepLowerBound, [Bicubic, BilinearAlignCorners], [None, None]),
    ("depth-anything-v2-metric-outdoor", IMAGENET, [518, 518, 14], Metric, KeepLowerBound, [Bicubic, BilinearAlignCorners], [None, None]),
    ("depth-anything-3-mono", IMAGENET, [504, 504, 14], RelativeDepth, KeepUpperBound, [Bicubic, Bilinear], [None, None]),
    ("depth-anything-3-metric", IMAGENET, [504, 504, 14], Metric, KeepUpperBound, [Bicubic, Bilinear], [None, Some(300.0)]),
    ("zoedepth", HALF, [512, 384, 32], Metric, KeepLowerBound, [Bilinear, Bilinear], [None, None]),
    ("depth-pro", HALF, [1536, 1536, 1], Metric, Squash, [Bilinear, Bilinear], [None, None]),
    ("unidepth-v2", IMAGENET, [630, 462, 1], Metric, Squash, [Bilinear, Bilinear], [None, None]),
    ("moge-2", PLAIN, [728, 728, 14], Metric, KeepUpperBound, [BilinearAntialias, Bilinear], [None, None]),
    ("metric3d-v2", BYTES, [1064, 616, 1], Metric, Pad, [Bilinear, Bilinear], [None, Some(1000.0)]),
    ("lite-mono", PLAIN, [640, 192, 1], AffineDisparity, Squash, [Bilinear, Bilinear], [None, None]),
    ("pydnet", PLAIN, [640, 192, 1], AffineDisparity, Squash, [Bilinear, Bilinear], [None, None]),
];

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
        let row = ROWS.into_iter().find(|row| row.0 == name);
        let (_, (mean, std), [width, height, multiple_of], output, aspect, filters, depths) =
            row.ok_or_else(|| Error::UnknownProfile { name: name.to_owned() })?;
        let ([input_filter, output_filter], [output_floor, canonical_focal]) = (filters, depths);
        let spec = Self {
            mean,
            std,
            multiple_of,
            aspect,
            input_filter,
            output_filter,
            output_floor,
            canonical_focal,
            ..Self::new(width, height, output)
        };
        let named = |name: &str| Some(name.to_owned());
        Ok(match name {
            "depth-pro" => Self { camera_output: named("focallength_px"), ..spec },
            "unidepth-v2" => Self {
                output_name: named("pts_3d"),
                output_channel: Some(2),
                camera_output: named("intrinsics"),
                // Its name misleads: the loss fits it to the error (unidepth/ops/losses/confidence.py).
                error_output: named("confidence"),
                ..spec
            },
            "moge-2" => Self {
                output_name: named("points"),
                output_channel: Some(2),
                scale_output: named("metric_scale"),
                mask_output: named("mask"),
                recover_shift: true,
                tokens: Some(1800),
                ..spec
            },
            _ => spec,
        })
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
                let (fov_output, output_name) = (named(fov), named(depth));
                return Self { camera_output: None, fov_output, output_name, ..self };
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
        let plain = |name: &str| name.chars().filter(char::is_ascii_alphanumeric).collect::<String>();
        let has = |part: &str| plain(&file).contains(part);
        let row = NAMES.iter().find(|(parts, _)| parts.iter().all(|part| has(part))).map(|(_, name)| *name);
        let profile = row.or_else(|| PROFILES.into_iter().find(|name| has(&plain(name))));
        match profile.filter(|name| *name != "pydnet" || !has("upydnet")) {
            Some(name) => Self::profile(name),
            None => Err(Error::UnknownProfile { name: file }),
        }
    }
}
