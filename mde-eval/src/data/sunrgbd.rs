use super::files::{Scenes, layout, only_file, read_pair, read_text};
use super::{DataSet, Sample, assumed};
use crate::Result;
use mde_prior::format::ReadOptions;
use mde_warp::PinholeCamera;
use std::path::Path;

/// SUN RGB-D (Song et al., CVPR 2015) in its published layout: any folder below the root that has both `image/` and `depth/` is a scene.
///
/// Depth files, the measurements of the sensor in `depth/`, are 16-bit PNGs of millimetres whose bits are rotated left by three, trusted up to 8 m.
/// `intrinsics.txt` holds the 3 x 3 matrix with pixels counted from 1, so 1 is taken from the principal point. A scene
/// without that file needs an assumed field of view. The place is known for the frames of SUN3D alone
/// (`sun3ddata/BUILDING/RECORDING/`); many others show the same rooms too.
#[derive(Debug, Clone)]
pub struct SunRgbd {
    scenes: Scenes,
    assumed_fov: Option<f64>,
}

impl SunRgbd {
    /// Finds the scenes at or below a folder. Those without a camera get square pixels and this horizontal field of view, degrees.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be read, [`Error::Layout`](crate::Error::Layout) where there is no scene.
    pub fn open(root: impl AsRef<Path>, assumed_fov: Option<f64>) -> Result<Self> {
        let what = "folder with `image/` and `depth/`; name SUN RGB-D's folder or one below it";
        Ok(Self { scenes: Scenes::find(root.as_ref(), Self::is_scene, what)?, assumed_fov })
    }

    pub(super) fn is_scene(folder: &Path) -> bool {
        folder.join("image").is_dir() && folder.join("depth").is_dir()
    }
}

impl DataSet for SunRgbd {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        let id = self.scenes.ids.get(index)?;
        // The frames of SUN3D lie in a folder per recording; the other sensors' images have no record of the place.
        let recording = id.split('/').any(|part| part == "sun3ddata").then(|| id.rsplit_once('/')).flatten();
        Some(recording.map_or(id, |(folder, _)| folder))
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (scene, id) = self.scenes.get(index)?;
        let image = only_file(&scene.join("image"), None, &["jpg", "jpeg", "png"])?;
        let depth = only_file(&scene.join("depth"), None, &["png"])?;
        // A scale of 1 leaves each sample as it is, within the integers that a float holds.
        let options = ReadOptions { png_scale: Some(1.0), ..ReadOptions::default() };
        let (image, rotated) = read_pair(&image, &depth, &options)?;
        let depth = rotated.mapv(|bits| (f64::from((bits as u16).rotate_right(3)) / 1000.0) as f32);
        let file = scene.join("intrinsics.txt");
        let known = file.is_file().then(|| read_intrinsics(&file, depth.dim())).transpose()?;
        let camera = known.map_or_else(|| assumed(self.assumed_fov, &file, depth.dim()), Ok)?;
        let assumed_camera = known.is_none();
        Ok(Sample { assumed_camera, trusted_depth: 8.0, ..Sample::new(id, image, depth, camera) })
    }
}

/// Nine numbers, row by row: `fx 0 cx 0 fy cy 0 0 1`, with pixels counted from 1.
fn read_intrinsics(path: &Path, (height, width): (usize, usize)) -> Result<PinholeCamera> {
    let numbers: Result<Vec<f64>, _> = read_text(path)?.split_whitespace().map(str::parse).collect();
    let Ok(&[fx, _, cx, _, fy, cy, _, _, _]) = numbers.as_deref() else {
        return Err(layout(path, "is no 3 x 3 matrix; nine numbers are needed: fx 0 cx, 0 fy cy, 0 0 1"));
    };
    PinholeCamera::new(fx, fy, cx - 1.0, cy - 1.0, width, height).map_err(|e| layout(path, e.to_string()))
}
