use super::files::{Scenes, layout, only_file, read_pair, read_text};
use super::{DataSet, Sample, assumed};
use crate::Result;
use mde_prior::format::ReadOptions;
use mde_warp::PinholeCamera;
use serde::Deserialize;
use std::path::Path;

/// Scenes of your own: any folder below the root that has a `scene.json`.
///
/// Beside it lie `color.*` (JPEG, PNG, TIFF, BMP, WebP) and `depth.*` (PNG of 16 bits, NPY, NPZ, PFM, EXR). The JSON's fields are
/// those of [`PlainScene`].
#[derive(Debug, Clone)]
pub struct PlainFolders {
    scenes: Scenes,
    assumed_fov: Option<f64>,
}

/// Content of a `scene.json`. All fields are optional and others are ignored; of the intrinsics all four are named or none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
pub struct PlainScene {
    /// Depth in metres = value / this; 1000 for integers and 1 for floats without it.
    pub depth_units_per_metre: Option<f64>,
    /// Horizontal focal length, pixels.
    pub fx: Option<f64>,
    /// Vertical focal length, pixels.
    pub fy: Option<f64>,
    /// Column of the principal point, pixel centres at integers from 0.
    pub cx: Option<f64>,
    /// Row of the principal point.
    pub cy: Option<f64>,
    /// Largest depth at which the truth is reliable, metres; 10 without it.
    pub max_depth: Option<f64>,
}

impl PlainFolders {
    const FILE: &'static str = "scene.json";

    /// Finds the scenes at or below a folder. Those without a camera get square pixels and this horizontal field of view, degrees.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be read, [`Error::Layout`](crate::Error::Layout) where there is no scene.
    pub fn open(root: impl AsRef<Path>, assumed_fov: Option<f64>) -> Result<Self> {
        let what = "folder with a `scene.json`; write one beside `color.png` and `depth.png`";
        let scenes = Scenes::find(root.as_ref(), |folder| folder.join(Self::FILE).is_file(), what)?;
        Ok(Self { scenes, assumed_fov })
    }
}

impl DataSet for PlainFolders {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (scene, id) = self.scenes.get(index)?;
        let path = scene.join(Self::FILE);
        let fault = |reason: String| layout(&path, reason);
        let description = PlainScene::parse(&read_text(&path)?).map_err(fault)?;
        let endings = ["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"];
        let image = only_file(scene, Some("color"), &endings)?;
        let depth = only_file(scene, Some("depth"), &["png", "npy", "npz", "pfm", "exr"])?;
        let options = description.depth_units_per_metre.map_or_else(ReadOptions::default, |scale| {
            ReadOptions { png_scale: Some(scale), float_scale: scale, ..ReadOptions::default() }
        });
        let (image, depth) = read_pair(&image, &depth, &options)?;
        let (height, width) = depth.dim();
        let known = description.camera(width, height).map_err(fault)?;
        let camera = known.map_or_else(|| assumed(self.assumed_fov, &path, depth.dim()), Ok)?;
        Ok(Sample {
            assumed_camera: known.is_none(),
            trusted_depth: description.max_depth.unwrap_or(10.0),
            ..Sample::new(id, image, depth, camera)
        })
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
