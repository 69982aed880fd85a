use super::files::{Scenes, entries, files_with, find_scenes, id, layout, read_pair};
use super::{DataSet, Sample};
use crate::Result;
use mde_prior::format::ReadOptions;
use mde_warp::PinholeCamera;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const IMAGES: [&str; 3] = ["jpg", "jpeg", "png"];
/// How folders of colour images are called.
const COLOUR: [&str; 5] = ["rgb", "color", "colour", "image", "images"];

/// NYU Depth v2 (Silberman et al., ECCV 2012) as files at or below a folder: pairs of an image and a PNG in millimetres, 0 = missing.
///
/// Two layouts are found: `rgb/00001.png` beside `depth/00001.png` (any file names whose first numbers agree), and
/// `rgb_00045.jpg` with `sync_depth_00045.png` in one folder, as the training sets of BTS and its successors have it: a recording,
/// whose frames show one place. The published `nyu_depth_v2_labeled.mat` must be exported first. Depth is trusted up to 10 m; the
/// camera is the published one of the colour sensor, scaled to the images' size.
#[derive(Debug, Clone)]
pub struct Nyu {
    scenes: Scenes<Pair>,
    places: Vec<String>,
}

/// An image and its depth map, as files.
type Pair = (PathBuf, PathBuf);

impl Nyu {
    /// Finds the pairs.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io) for a folder that cannot be read, [`Error::Layout`](crate::Error::Layout) where there is no pair.
    pub fn open(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        if root.extension().is_some_and(|e| e == "mat") {
            let reason =
                "is MATLAB's format, which is not read; export it as rgb/N.png and depth/N.png (16 bit, mm)";
            return Err(layout(root, reason));
        }
        let (mut scenes, mut places) = (Vec::new(), Vec::new());
        for folder in find_scenes(root, |folder| Self::is_side_by_side(folder) || Self::is_recording(folder))?
        {
            let own = id(root, &folder);
            for pair in pairs_of(&folder)? {
                let stem = pair.0.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                let name = if folder == root { stem } else { format!("{own}/{stem}") };
                // The labelled images are of many places; the files of a recording lie in one folder.
                places.push(if Self::is_side_by_side(&folder) { name.clone() } else { own.clone() });
                scenes.push((name, pair));
            }
        }
        if scenes.is_empty() {
            let reason = "holds no rgb/N.png beside depth/N.png and no rgb_N.jpg with sync_depth_N.png";
            return Err(layout(root, reason));
        }
        Ok(Self { scenes: scenes.into_iter().collect(), places })
    }

    /// Whether a folder holds a folder of images beside one of depth maps.
    pub(super) fn is_side_by_side(folder: &Path) -> bool {
        side_by_side(folder).is_some()
    }

    /// Whether a folder holds depth maps of a recording.
    pub(super) fn is_recording(folder: &Path) -> bool {
        entries(folder).is_ok_and(|paths| paths.iter().any(|path| starts_with(path, "sync_depth_")))
    }
}

impl DataSet for Nyu {
    fn ids(&self) -> &[String] {
        &self.scenes.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.places.get(index).map(String::as_str)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let ((image_path, depth_path), id) = self.scenes.get(index)?;
        let options = ReadOptions { png_scale: Some(1000.0), ..ReadOptions::default() };
        let (image, depth) = read_pair(image_path, depth_path, &options)?;
        let (height, width) = depth.dim();
        if width * 480 != height * 640 {
            let reason = format!(
                "is {width}x{height}, but the published camera is that of 640x480; use a plain folder with a scene.json"
            );
            return Err(layout(image_path, reason));
        }
        // The published principal point counts pixels from 1.
        let published =
            PinholeCamera::new(518.857_901, 519.469_611, 325.582_449 - 1.0, 253.736_166 - 1.0, 640, 480)?;
        let camera = published.resized(width, height)?;
        Ok(Sample { trusted_depth: 10.0, ..Sample::new(id, image, depth, camera) })
    }
}

/// The folder of images and the one of depth maps in a folder.
fn side_by_side(folder: &Path) -> Option<(PathBuf, PathBuf)> {
    let colour = COLOUR.iter().map(|name| folder.join(name)).find(|path| path.is_dir())?;
    Some((colour, folder.join("depth"))).filter(|(_, depth)| depth.is_dir())
}

fn starts_with(path: &Path, prefix: &str) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix))
}

/// The pairs of a folder, by the first number in the files' names; what has no counterpart is left out.
fn pairs_of(folder: &Path) -> Result<Vec<Pair>> {
    let (images, depths): (Vec<PathBuf>, Vec<PathBuf>) = match side_by_side(folder) {
        Some((colour, depth)) => (files_with(&colour, &IMAGES)?, files_with(&depth, &["png"])?),
        None => {
            let files = files_with(folder, &IMAGES)?;
            let named = |prefix| files.iter().filter(|path| starts_with(path, prefix)).cloned().collect();
            (named("rgb_"), named("sync_depth_"))
        }
    };
    let mut depth_of = BTreeMap::new();
    for path in depths {
        let Some(number) = number(&path) else { continue };
        if let Some(other) = depth_of.insert(number, path.clone()) {
            let reason = format!("has the same number as {}; name each frame's depth once", other.display());
            return Err(layout(&path, reason));
        }
    }
    let pair = |image: PathBuf| {
        let depth = depth_of.get(&number(&image)?)?.clone();
        Some((image, depth))
    };
    Ok(images.into_iter().filter_map(pair).collect())
}

/// The first run of digits in a file's name.
fn number(path: &Path) -> Option<u64> {
    let name = path.file_stem()?.to_string_lossy().into_owned();
    let digits = name.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit);
    digits.collect::<String>().parse().ok()
}
