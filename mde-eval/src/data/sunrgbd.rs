use super::files::{files_with, find_scenes, id, same_size};
use super::{DataSet, Fallback, Sample, out_of_range};
use crate::{Error, Result};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::read_image;
use mde_warp::PinholeCamera;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};

/// Which of SUN RGB-D's depth maps is the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SunDepth {
    /// `depth/`: the measurements of the sensor.
    #[default]
    Sensor,
    /// `depth_bfx/`: the same with its holes filled, often wrongly.
    Filled,
}

impl SunDepth {
    const fn folder(self) -> &'static str {
        match self {
            Self::Sensor => "depth",
            Self::Filled => "depth_bfx",
        }
    }
}

/// SUN RGB-D (Song et al., CVPR 2015) in its published layout: any folder below the root that has both `image/` and
/// `depth/` is a scene.
///
/// Depth files are 16-bit PNGs with rotated bits ([`mde_prior::format::Encoding::Sunrgbd`]), trusted up to 8 m.
/// `intrinsics.txt` holds the 3 x 3 matrix with pixels counted from 1, so 1 is taken from the principal point. A scene
/// without that file is [`Error::Intrinsics`] unless a [`Fallback`] is named. The place is known for the frames of SUN3D alone
/// (`sun3ddata/BUILDING/RECORDING/`); many others show the same rooms too, which [`Placed`](super::Placed) can name.
///
/// ```no_run
/// use mde_eval::data::{DataSet, Fallback, SunRgbd};
///
/// let data = SunRgbd::open("SUNRGBD")?.with_fallback(Fallback::FieldOfView(57.0));
/// let first = data.load(0)?;
/// println!("{} {:?}", first.id, first.camera);
/// # Ok::<(), mde_eval::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SunRgbd {
    scenes: Vec<PathBuf>,
    ids: Vec<String>,
    depth: SunDepth,
    fallback: Fallback,
}

impl SunRgbd {
    const FILE: &'static str = "intrinsics.txt";

    /// Finds the scenes at or below a folder.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Layout`] where there is no scene.
    pub fn open(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let scenes = find_scenes(root, Self::is_scene)?;
        if scenes.is_empty() {
            let reason =
                "holds no folder with `image/` and `depth/`; name SUN RGB-D's folder or one below it".into();
            return Err(Error::Layout { path: root.to_owned(), reason });
        }
        let ids = scenes.iter().map(|scene| id(root, scene)).collect();
        Ok(Self { scenes, ids, depth: SunDepth::Sensor, fallback: Fallback::Refuse })
    }

    pub(super) fn is_scene(folder: &Path) -> bool {
        folder.join("image").is_dir() && folder.join("depth").is_dir()
    }

    /// With another depth map as the truth.
    #[must_use]
    pub fn with_depth(mut self, depth: SunDepth) -> Self {
        self.depth = depth;
        self
    }

    /// With a camera for scenes that have none.
    #[must_use]
    pub fn with_fallback(mut self, fallback: Fallback) -> Self {
        self.fallback = fallback;
        self
    }
}

impl DataSet for SunRgbd {
    fn ids(&self) -> &[String] {
        &self.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        let id = self.ids.get(index)?;
        // The frames of SUN3D lie in a folder per recording; the other sensors' images have no record of the place.
        let recording = id.split('/').any(|part| part == "sun3ddata").then(|| id.rsplit_once('/')).flatten();
        Some(recording.map_or(id, |(folder, _)| folder))
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (Some(scene), Some(id)) = (self.scenes.get(index), self.ids.get(index)) else {
            return Err(out_of_range(index, self.scenes.len()));
        };
        let image = read_image(only_file(&scene.join("image"), &["jpg", "jpeg", "png"])?)?.pixels;
        let depth_path = only_file(&scene.join(self.depth.folder()), &["png"])?;
        let depth = read_depth(&depth_path, &ReadOptions::sunrgbd())?;
        let (height, width, _) = image.dim();
        same_size(&depth_path, depth.dim(), (height, width))?;
        let file = scene.join(Self::FILE);
        let assumed_camera = !file.is_file();
        let camera = if assumed_camera {
            self.fallback.camera(id, Self::FILE, width, height)?
        } else {
            read_intrinsics(&file, width, height)?
        };
        Ok(Sample { assumed_camera, trusted_depth: 8.0, ..Sample::new(id, image, depth, camera) })
    }
}

fn only_file(folder: &Path, extensions: &[&str]) -> Result<PathBuf> {
    if !folder.is_dir() {
        return Err(Error::Layout { path: folder.to_owned(), reason: "the scene has no such folder".into() });
    }
    let files = files_with(folder, extensions)?;
    match files.as_slice() {
        [file] => Ok(file.clone()),
        _ => {
            let reason =
                format!("holds {} files (.{}) where one is needed", files.len(), extensions.join(", ."));
            Err(Error::Layout { path: folder.to_owned(), reason })
        }
    }
}

/// Nine numbers, row by row: `fx 0 cx 0 fy cy 0 0 1`, with pixels counted from 1.
fn read_intrinsics(path: &Path, width: usize, height: usize) -> Result<PinholeCamera> {
    let text = fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[fx, _, cx, _, fy, cy, _, _, _]) => {
            let camera = PinholeCamera::new(fx, fy, cx - 1.0, cy - 1.0, width, height);
            camera.map_err(|e| Error::Layout { path: path.to_owned(), reason: e.to_string() })
        }
        _ => {
            let reason = "is no 3 x 3 matrix; nine numbers are needed: fx 0 cx, 0 fy cy, 0 0 1".into();
            Err(Error::Layout { path: path.to_owned(), reason })
        }
    }
}
