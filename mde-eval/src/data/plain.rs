use super::files::{files_with, find_scenes, id, same_size};
use super::{DataSet, Fallback, Sample, out_of_range};
use crate::{Error, Result};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::read_image;
use mde_warp::PinholeCamera;
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};

/// Scenes of your own: any folder below the root that has a `scene.json`.
///
/// Beside it lie `color.*` (JPEG, PNG, TIFF, BMP, WebP) and `depth.*` (PNG of 16 bits, NPY, NPZ, PFM, EXR). The JSON's fields are
/// all optional and others are ignored:
///
/// | field | meaning |
/// | --- | --- |
/// | `depth_units_per_metre` | depth in metres = value / this; 1000 for integers and 1 for floats without it |
/// | `fx`, `fy`, `cx`, `cy` | intrinsics in pixels, pixel centres at integers from 0; all four or none |
/// | `max_depth` | depths beyond it, in metres, are not used; 10 without it |
#[derive(Debug, Clone)]
pub struct PlainFolders {
    scenes: Vec<PathBuf>,
    ids: Vec<String>,
    fallback: Fallback,
}

/// Content of a `scene.json`; see [`PlainFolders`] for its fields.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
pub struct PlainScene {
    /// Depth in metres = value / this.
    pub depth_units_per_metre: Option<f64>,
    /// Horizontal focal length, pixels.
    pub fx: Option<f64>,
    /// Vertical focal length, pixels.
    pub fy: Option<f64>,
    /// Column of the principal point, from 0.
    pub cx: Option<f64>,
    /// Row of the principal point, from 0.
    pub cy: Option<f64>,
    /// Largest depth at which the truth is reliable, metres.
    pub max_depth: Option<f64>,
}

impl PlainFolders {
    const FILE: &'static str = "scene.json";

    /// Finds the scenes at or below a folder.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Layout`] where there is no scene.
    pub fn open(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let scenes = find_scenes(root, |folder| folder.join(Self::FILE).is_file())?;
        if scenes.is_empty() {
            let reason =
                "holds no folder with a `scene.json`; write one beside `color.png` and `depth.png`".into();
            return Err(Error::Layout { path: root.to_owned(), reason });
        }
        let ids = scenes.iter().map(|scene| id(root, scene)).collect();
        Ok(Self { scenes, ids, fallback: Fallback::Refuse })
    }

    /// With a camera for scenes that have none.
    #[must_use]
    pub fn with_fallback(mut self, fallback: Fallback) -> Self {
        self.fallback = fallback;
        self
    }
}

impl DataSet for PlainFolders {
    fn ids(&self) -> &[String] {
        &self.ids
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (Some(scene), Some(id)) = (self.scenes.get(index), self.ids.get(index)) else {
            return Err(out_of_range(index, self.scenes.len()));
        };
        let path = scene.join(Self::FILE);
        let description = describe(&path)?;
        let image =
            read_image(named(scene, "color", &["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"])?)?.pixels;
        let depth_path = named(scene, "depth", &["png", "npy", "npz", "pfm", "exr"])?;
        let depth = read_depth(&depth_path, &options(description.depth_units_per_metre))?;
        let (height, width, _) = image.dim();
        same_size(&depth_path, depth.dim(), (height, width))?;
        let known = description
            .camera(width, height)
            .map_err(|reason| Error::Layout { path: path.clone(), reason })?;
        let camera = match known {
            Some(camera) => camera,
            None => self.fallback.camera(id, "fx, fy, cx, cy in scene.json", width, height)?,
        };
        Ok(Sample {
            assumed_camera: known.is_none(),
            trusted_depth: description.max_depth.unwrap_or(10.0),
            ..Sample::new(id, image, depth, camera)
        })
    }
}

fn describe(path: &Path) -> Result<PlainScene> {
    let text = fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    PlainScene::parse(&text).map_err(|reason| Error::Layout { path: path.to_owned(), reason })
}

fn options(units_per_metre: Option<f64>) -> ReadOptions {
    match units_per_metre {
        Some(scale) => ReadOptions { png_scale: Some(scale), float_scale: scale, ..ReadOptions::default() },
        None => ReadOptions::default(),
    }
}

impl PlainScene {
    /// Reads the text of a `scene.json` and checks its values.
    ///
    /// # Errors
    /// The fault and its remedy.
    pub fn parse(text: &str) -> Result<Self, String> {
        let scene: Self = serde_json::from_str(text)
            .map_err(|fault| format!("is not valid: {fault}; write JSON such as {{}}"))?;
        for (name, value) in
            [("max_depth", scene.max_depth), ("depth_units_per_metre", scene.depth_units_per_metre)]
        {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(format!("{name} is {value}; it must be positive and finite"));
            }
        }
        Ok(scene)
    }

    /// The camera of an image of this size, where the scene names one.
    ///
    /// # Errors
    /// The fault and its remedy.
    pub fn camera(&self, width: usize, height: usize) -> Result<Option<PinholeCamera>, String> {
        match (self.fx, self.fy, self.cx, self.cy) {
            (Some(fx), Some(fy), Some(cx), Some(cy)) => {
                PinholeCamera::new(fx, fy, cx, cy, width, height).map(Some).map_err(|e| e.to_string())
            }
            (None, None, None, None) => Ok(None),
            _ => Err("names some of fx, fy, cx, cy; name all four or none".into()),
        }
    }
}

/// The one file of that stem.
fn named(scene: &Path, stem: &str, extensions: &[&str]) -> Result<PathBuf> {
    let of_stem = |path: &PathBuf| path.file_stem().is_some_and(|s| s == stem);
    let files: Vec<_> = files_with(scene, extensions)?.into_iter().filter(of_stem).collect();
    match files.as_slice() {
        [file] => Ok(file.clone()),
        _ => {
            let reason = format!(
                "holds {} files named {stem}.* (.{}) where one is needed",
                files.len(),
                extensions.join(", .")
            );
            Err(Error::Layout { path: scene.to_owned(), reason })
        }
    }
}
