//! The files that model hubs keep beside a network: `config.json` and `preprocessor_config.json` of Transformers.

use super::profiles::HALF;
use super::spec::{Aspect, ModelSpec, text_of};
use crate::resample::Filter;
use crate::{DepthKind, Error, Result};
use serde::Deserialize;
use std::path::Path;

/// `config.json`, as far as it decides the meaning of the output.
#[derive(Deserialize)]
struct Model {
    /// Without one, the file is of another program.
    model_type: Option<String>,
    depth_estimation_type: Option<String>,
}

/// `preprocessor_config.json`.
#[derive(Deserialize)]
struct Preprocessor {
    size: Option<Size>,
    #[serde(default)]
    keep_aspect_ratio: bool,
    ensure_multiple_of: Option<usize>,
    do_normalize: Option<bool>,
    image_mean: Option<[f32; 3]>,
    image_std: Option<[f32; 3]>,
    /// Pillow's number of the filter.
    resample: Option<u8>,
}

/// One number is both sides.
#[derive(Deserialize)]
#[serde(untagged, expecting = "size is neither a number nor height and width")]
enum Size {
    Both(usize),
    Each { height: usize, width: usize },
}

impl ModelSpec {
    /// The specification by the files of a model hub beside the model, or in the folder above (`onnx/model.onnx`): `config.json` with
    /// `preprocessor_config.json`. `None` where there is none, or for a type whose input or output is not known here; GLPN is one: its input
    /// has the image's own size, which no specification states.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Malformed`] that names the file and the ways around it.
    pub fn of_hub(model: impl AsRef<Path>) -> Result<Option<Self>> {
        for folder in model.as_ref().ancestors().skip(1).take(2) {
            let Some(config) = read::<Model>(&folder.join("config.json"))? else { continue };
            if let Some(usual) = usual(&config) {
                let preprocessor = read(&folder.join("preprocessor_config.json"))?;
                return Ok(Some(described(usual, preprocessor.as_ref())));
            }
            if config.model_type.is_some() {
                return Ok(None);
            }
        }
        Ok(None)
    }
}

/// The specification of a type, as its authors' networks have it.
fn usual(model: &Model) -> Option<ModelSpec> {
    let metric = model.depth_estimation_type.as_deref() == Some("metric");
    let (profile, output) = match model.model_type.as_deref()? {
        "depth_anything" if metric => ("depth-anything-v2", DepthKind::Metric),
        "depth_anything" => ("depth-anything-v2", DepthKind::AffineDisparity),
        "dpt" if metric => ("dpt-large", DepthKind::Metric),
        "dpt" => ("dpt-large", DepthKind::AffineDisparity),
        "zoedepth" => ("zoedepth", DepthKind::Metric),
        "depth_pro" => ("depth-pro", DepthKind::Metric),
        _ => return None,
    };
    Some(ModelSpec { output, ..ModelSpec::profile(profile).ok()? })
}

fn described(mut spec: ModelSpec, preprocessor: Option<&Preprocessor>) -> ModelSpec {
    let Some(given) = preprocessor else { return spec };
    match given.size {
        Some(Size::Both(side)) => (spec.height, spec.width) = (side, side),
        Some(Size::Each { height, width }) => (spec.height, spec.width) = (height, width),
        None => {}
    }
    spec.multiple_of = given.ensure_multiple_of.unwrap_or(1);
    spec.aspect = if given.keep_aspect_ratio { Aspect::KeepMinimal } else { Aspect::Squash };
    (spec.mean, spec.std) = match (given.do_normalize, given.image_mean, given.image_std) {
        (Some(false), _, _) => ([0.0; 3], [1.0; 3]),
        (_, Some(mean), Some(std)) => (mean, std),
        // What the processors of these types take.
        _ => HALF,
    };
    spec.input_filter = match given.resample {
        Some(2) => Filter::Bilinear,
        Some(3) => Filter::Bicubic,
        _ => spec.input_filter,
    };
    spec
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<Option<T>> {
    let Some(text) = text_of(path)? else { return Ok(None) };
    serde_json::from_str(&text).map(Some).map_err(|e| {
        let around = "correct it, or describe the network by a profile or a TOML file beside it";
        Error::malformed(path, format!("{e}; {around}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hub_folder_describes_its_network() {
        let root = tempfile::tempdir().unwrap();
        let model = root.path().join("onnx").join("model.onnx");
        assert_eq!(ModelSpec::of_hub(&model).unwrap(), None);
        let of = |config: &str| {
            std::fs::write(root.path().join("config.json"), config).unwrap();
            ModelSpec::of_hub(&model)
        };
        let metric =
            of(r#"{"model_type": "depth_anything", "depth_estimation_type": "metric", "max_depth": 20}"#);
        let spec = metric.unwrap().unwrap();
        assert_eq!((spec.output, spec.width, spec.multiple_of), (DepthKind::Metric, 518, 14));
        let relative = of(r#"{"model_type": "depth_anything"}"#).unwrap().unwrap();
        assert_eq!(relative.output, DepthKind::AffineDisparity);
        // The second is of another program.
        for config in [r#"{"model_type": "glpn", "max_depth": 10}"#, r#"{"theme": "dark"}"#] {
            assert_eq!(of(config).unwrap(), None);
        }
        assert!(of("{").unwrap_err().to_string().contains("config.json"));
    }

    /// Files with the keys of published ones: Intel/dpt-large, depth-anything/Depth-Anything-V2-Small-hf, Intel/zoedepth-nyu-kitti,
    /// apple/DepthPro-hf.
    #[test]
    fn the_files_of_published_networks_are_read() {
        let of = |config: &str, preprocessor: &str| {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join("config.json"), config).unwrap();
            std::fs::write(folder.path().join("preprocessor_config.json"), preprocessor).unwrap();
            ModelSpec::of_hub(folder.path().join("model.onnx"))
        };
        let dpt = of(
            r#"{"architectures": ["DPTForDepthEstimation"], "model_type": "dpt", "image_size": 384, "torch_dtype": "float32"}"#,
            r#"{"do_normalize": true, "do_resize": true, "ensure_multiple_of": 1, "feature_extractor_type": "DPTFeatureExtractor",
                "image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5], "keep_aspect_ratio": false, "resample": 2, "size": 384}"#,
        );
        let squashed = ModelSpec {
            mean: [0.5; 3],
            std: [0.5; 3],
            ..ModelSpec::new(384, 384, DepthKind::AffineDisparity)
        };
        assert_eq!(dpt.unwrap(), Some(ModelSpec { output_filter: Filter::Bicubic, ..squashed }));
        let anything = of(
            r#"{"architectures": ["DepthAnythingForDepthEstimation"], "depth_estimation_type": "relative", "max_depth": null,
                "model_type": "depth_anything"}"#,
            r#"{"do_normalize": true, "do_pad": false, "do_rescale": true, "do_resize": true, "ensure_multiple_of": 14,
                "image_mean": [0.485, 0.456, 0.406], "image_processor_type": "DPTImageProcessor",
                "image_std": [0.229, 0.224, 0.225], "keep_aspect_ratio": true, "resample": 3, "rescale_factor": 0.00392156862745098,
                "size": {"height": 518, "width": 518}, "size_divisor": null}"#,
        );
        let profile = ModelSpec::profile("depth-anything-v2").unwrap();
        assert_eq!(anything.unwrap(), Some(ModelSpec { aspect: Aspect::KeepMinimal, ..profile }));
        let zoe = of(
            r#"{"architectures": ["ZoeDepthForDepthEstimation"], "model_type": "zoedepth"}"#,
            r#"{"do_normalize": true, "do_pad": true, "do_rescale": true, "do_resize": true, "ensure_multiple_of": 32,
                "image_processor_type": "ZoeDepthImageProcessor", "keep_aspect_ratio": true, "resample": 2,
                "size": {"height": 384, "width": 512}}"#,
        );
        let zoe = zoe.unwrap().unwrap();
        // No mean in the file: 0.5, as the processor takes.
        assert_eq!((zoe.width, zoe.height, zoe.multiple_of, zoe.mean), (512, 384, 32, [0.5; 3]));
        assert_eq!((zoe.aspect, zoe.input_filter), (Aspect::KeepMinimal, Filter::Bilinear));
        let pro = of(
            r#"{"architectures": ["DepthProForDepthEstimation"], "model_type": "depth_pro", "use_fov_model": true}"#,
            r#"{"do_normalize": true, "do_rescale": true, "do_resize": true, "image_mean": [0.5, 0.5, 0.5],
                "image_processor_type": "DepthProImageProcessorFast", "image_std": [0.5, 0.5, 0.5], "resample": 2,
                "size": {"height": 1536, "width": 1536}}"#,
        );
        assert_eq!(pro.unwrap(), Some(ModelSpec::profile("depth-pro").unwrap()));
        let error = of(r#"{"model_type": "dpt"}"#, r#"{"size": {"shortest_edge": 384}}"#).unwrap_err();
        let error = error.to_string();
        let reason = "preprocessor_config.json: size is neither a number nor height and width";
        assert!(error.contains(reason) && error.contains("profile") && error.lines().count() == 1, "{error}");
    }
}
