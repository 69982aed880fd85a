//! The files that model hubs keep beside a network: `config.json` and `preprocessor_config.json` of Transformers.

use super::profiles::IMAGENET;
use super::spec::{Aspect, ModelSpec};
use crate::resample::Filter;
use crate::{DepthKind, Error, Result};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// `config.json`, as far as it decides the meaning of the output.
#[derive(Deserialize)]
struct Model {
    model_type: String,
    #[serde(default)]
    depth_estimation_type: Option<String>,
}

/// `preprocessor_config.json`.
#[derive(Deserialize)]
struct Preprocessor {
    #[serde(default)]
    size: Option<Size>,
    #[serde(default)]
    keep_aspect_ratio: bool,
    #[serde(default)]
    ensure_multiple_of: Option<usize>,
    #[serde(default)]
    do_normalize: Option<bool>,
    #[serde(default)]
    image_mean: Option<[f32; 3]>,
    #[serde(default)]
    image_std: Option<[f32; 3]>,
    /// Pillow's number of the filter.
    #[serde(default)]
    resample: Option<u8>,
}

#[derive(Deserialize)]
struct Size {
    height: usize,
    width: usize,
}

impl ModelSpec {
    /// The specification by the files of a model hub beside the model, or in the folder above (`onnx/model.onnx`): `config.json` with
    /// `preprocessor_config.json`. `None` where there is none, or for a type that has no monocular depth of a known meaning.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Malformed`] that names the file.
    pub fn of_hub(model: impl AsRef<Path>) -> Result<Option<Self>> {
        let folder = model.as_ref().parent().map_or_else(PathBuf::new, Path::to_owned);
        let folders = [Some(folder.as_path()), folder.parent()];
        for folder in folders.into_iter().flatten() {
            if let Some(config) = read::<Model>(&folder.join("config.json"))? {
                let preprocessor = read(&folder.join("preprocessor_config.json"))?;
                return Ok(described(&config, preprocessor.as_ref()));
            }
        }
        Ok(None)
    }
}

fn described(model: &Model, preprocessor: Option<&Preprocessor>) -> Option<ModelSpec> {
    let metric = model.depth_estimation_type.as_deref() == Some("metric");
    let output = match model.model_type.as_str() {
        "depth_anything" | "dpt" if metric => DepthKind::Metric,
        "depth_anything" | "dpt" => DepthKind::AffineDisparity,
        "zoedepth" | "glpn" | "depth_pro" => DepthKind::Metric,
        _ => return None,
    };
    let usual = match model.model_type.as_str() {
        "depth_anything" => ModelSpec::profile("depth-anything-v2"),
        "zoedepth" => ModelSpec::profile("zoedepth"),
        "depth_pro" => ModelSpec::profile("depth-pro"),
        _ => ModelSpec::profile("dpt-large"),
    };
    let mut spec = ModelSpec { output, ..usual.ok()? };
    let Some(given) = preprocessor else { return Some(spec) };
    if let Some(Size { height, width }) = given.size {
        (spec.height, spec.width) = (height, width);
    }
    spec.multiple_of = given.ensure_multiple_of.unwrap_or(1);
    spec.aspect = if given.keep_aspect_ratio { Aspect::KeepMinimal } else { Aspect::Squash };
    (spec.mean, spec.std) = match (given.do_normalize, given.image_mean, given.image_std) {
        (Some(false), _, _) => ([0.0; 3], [1.0; 3]),
        (_, Some(mean), Some(std)) => (mean, std),
        _ => IMAGENET,
    };
    spec.input_filter = match given.resample {
        Some(2) => Filter::Bilinear,
        _ => Filter::Bicubic,
    };
    Some(spec)
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<Option<T>> {
    match std::fs::read_to_string(path) {
        Ok(text) => serde_json::from_str(&text).map(Some).map_err(|e| Error::malformed(path, e.to_string())),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Error::read(path, e)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) {
        std::fs::write(folder.join(name), text).unwrap();
    }

    #[test]
    fn a_hub_folder_describes_its_network() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path();
        let model = folder.join("onnx").join("model.onnx");
        assert_eq!(ModelSpec::of_hub(&model).unwrap(), None);
        write(
            folder,
            "config.json",
            r#"{"model_type": "depth_anything", "depth_estimation_type": "metric", "max_depth": 20}"#,
        );
        let spec = ModelSpec::of_hub(&model).unwrap().unwrap();
        assert_eq!((spec.output, spec.width, spec.multiple_of), (DepthKind::Metric, 518, 14));
        write(
            folder,
            "preprocessor_config.json",
            r#"{"size": {"height": 384, "width": 512}, "keep_aspect_ratio": true, "ensure_multiple_of": 32, "resample": 2,
                "image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5], "do_normalize": true}"#,
        );
        let spec = ModelSpec::of_hub(&model).unwrap().unwrap();
        assert_eq!(
            (spec.height, spec.width, spec.multiple_of, spec.aspect),
            (384, 512, 32, Aspect::KeepMinimal)
        );
        assert_eq!((spec.mean, spec.input_filter), ([0.5; 3], Filter::Bilinear));
        write(folder, "config.json", r#"{"model_type": "depth_anything"}"#);
        assert_eq!(ModelSpec::of_hub(&model).unwrap().unwrap().output, DepthKind::AffineDisparity);
        write(folder, "config.json", r#"{"model_type": "bert"}"#);
        assert_eq!(ModelSpec::of_hub(&model).unwrap(), None);
        write(folder, "config.json", "{");
        assert!(ModelSpec::of_hub(&model).unwrap_err().to_string().contains("config.json"));
    }
}
