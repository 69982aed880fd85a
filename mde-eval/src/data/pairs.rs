use super::files::{entries, files_with, id, same_size};
use super::{DataSet, Sample, out_of_range};
use crate::{Error, Result};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::read_image;
use mde_warp::PinholeCamera;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const IMAGES: [&str; 3] = ["jpg", "jpeg", "png"];
/// How folders of colour images are called.
const COLOUR: [&str; 5] = ["rgb", "color", "colour", "image", "images"];

/// An image and its depth map, as files.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) image: PathBuf,
    pub(super) depth: PathBuf,
    /// The folder that both belong to.
    pub(super) sequence: PathBuf,
}

impl Pair {
    pub(super) fn id(&self, root: &Path) -> String {
        let stem = self.image.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if self.sequence == root { stem } else { format!("{}/{stem}", id(root, &self.sequence)) }
    }
}

/// Frames of recordings: pairs of an image and a 16-bit depth PNG, of NYU Depth v2, TUM RGB-D or Redwood.
#[derive(Debug, Clone)]
pub struct Sequences {
    pairs: Vec<Pair>,
    ids: Vec<String>,
    /// The place of each pair.
    places: Vec<String>,
    sensor: Sensor,
    assumed_fov: Option<f64>,
}

/// The camera of a pair whose image has that width and height, and whether its field of view is assumed.
type CameraOf = fn(&Pair, [usize; 2], Option<f64>) -> Result<(PinholeCamera, bool)>;

/// What the frames of a data set have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sensor {
    pub(super) units_per_metre: f64,
    pub(super) trusted_depth: f64,
    pub(super) camera: CameraOf,
}

impl Sequences {
    /// `recorded` is whether a pair is a frame of a recording, whose frames show one place; without a pair the root holds none of
    /// `what`.
    pub(super) fn new(
        root: &Path,
        pairs: Vec<Pair>,
        sensor: Sensor,
        recorded: impl Fn(&Pair) -> bool,
        what: &str,
    ) -> Result<Self> {
        if pairs.is_empty() {
            return Err(Error::Layout { path: root.to_owned(), reason: format!("holds no {what}") });
        }
        let ids: Vec<String> = pairs.iter().map(|pair| pair.id(root)).collect();
        let place = |(pair, own): (&Pair, &String)| match recorded(pair) {
            true => id(root, &pair.sequence),
            false => own.clone(),
        };
        let places = pairs.iter().zip(&ids).map(place).collect();
        Ok(Self { places, pairs, ids, sensor, assumed_fov: None })
    }

    /// Only every `stride`-th image: neighbours in a video show the same.
    #[must_use]
    pub fn with_stride(mut self, stride: usize) -> Self {
        let stride = stride.max(1);
        self.pairs = self.pairs.drain(..).step_by(stride).collect();
        self.ids = self.ids.drain(..).step_by(stride).collect();
        self.places = self.places.drain(..).step_by(stride).collect();
        self
    }

    /// With square pixels and this horizontal field of view, degrees, where the camera is not known.
    #[must_use]
    pub fn with_assumed_fov(mut self, degrees: impl Into<Option<f64>>) -> Self {
        self.assumed_fov = degrees.into();
        self
    }
}

impl DataSet for Sequences {
    fn ids(&self) -> &[String] {
        &self.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.places.get(index).map(String::as_str)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let (Some(pair), Some(id)) = (self.pairs.get(index), self.ids.get(index)) else {
            return Err(out_of_range(index, self.pairs.len()));
        };
        let Sensor { units_per_metre, trusted_depth, camera } = self.sensor;
        let image = read_image(&pair.image)?.pixels;
        let options = ReadOptions { png_scale: Some(units_per_metre), ..ReadOptions::default() };
        let depth = read_depth(&pair.depth, &options)?;
        let (height, width, _) = image.dim();
        same_size(&pair.depth, depth.dim(), (height, width))?;
        let (camera, assumed_camera) = camera(pair, [width, height], self.assumed_fov)?;
        Ok(Sample { assumed_camera, trusted_depth, ..Sample::new(id, image, depth, camera) })
    }
}

/// Whether a folder holds a folder of images beside one of depth maps.
pub(super) fn side_by_side(folder: &Path) -> bool {
    colour_folder(folder).is_some() && folder.join("depth").is_dir()
}

fn colour_folder(folder: &Path) -> Option<PathBuf> {
    COLOUR.iter().map(|name| folder.join(name)).find(|path| path.is_dir())
}

/// Pairs of a folder that is [`side_by_side`], by the first number in the files' names.
pub(super) fn pairs_side_by_side(folder: &Path) -> Result<Vec<Pair>> {
    let Some(colour) = colour_folder(folder) else { return Ok(Vec::new()) };
    let images = files_with(&colour, &IMAGES)?;
    let depths = files_with(&folder.join("depth"), &["png"])?;
    by_number(folder, images, depths)
}

/// Pairs `rgb_N.jpg` with `sync_depth_N.png` in one folder.
pub(super) fn pairs_in_one_folder(folder: &Path) -> Result<Vec<Pair>> {
    let starts = |prefix: &'static str| {
        move |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(prefix))
    };
    let files = files_with(folder, &IMAGES)?;
    let images = files.iter().filter(|path| starts("rgb_")(path)).cloned().collect();
    let depths = files.into_iter().filter(starts("sync_depth_")).collect();
    by_number(folder, images, depths)
}

/// Whether a folder holds files that [`pairs_in_one_folder`] would pair.
pub(super) fn in_one_folder(folder: &Path) -> bool {
    let found =
        |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().starts_with("sync_depth_"));
    entries(folder).is_ok_and(|paths| paths.iter().any(found))
}

/// Pictures without a depth map, and the other way round, are left out.
fn by_number(folder: &Path, images: Vec<PathBuf>, depths: Vec<PathBuf>) -> Result<Vec<Pair>> {
    let mut depth_of = BTreeMap::new();
    for path in depths {
        let Some(number) = number(&path) else { continue };
        if let Some(other) = depth_of.insert(number, path.clone()) {
            let reason = format!("has the same number as {}; name each frame's depth once", other.display());
            return Err(Error::Layout { path, reason });
        }
    }
    let pair = |image: PathBuf| {
        let depth = depth_of.get(&number(&image)?)?.clone();
        Some(Pair { image, depth, sequence: folder.to_owned() })
    };
    Ok(images.into_iter().filter_map(pair).collect())
}

/// The first run of digits in a file's name.
fn number(path: &Path) -> Option<u64> {
    let name = path.file_stem()?.to_string_lossy().into_owned();
    let digits = name.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit);
    digits.collect::<String>().parse().ok()
}
