use super::files::{entries, files_with, id, same_size};
use super::{Sample, out_of_range};
use crate::{Error, Result};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::read_image;
use mde_warp::PinholeCamera;
use ndarray::{Array2, Array3};
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

/// Image and depth map of a pair, and the image's width and height.
pub(super) type Read = (Array3<f32>, Array2<f32>, [usize; 2]);

impl Pair {
    pub(super) fn id(&self, root: &Path) -> String {
        let stem = self.image.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if self.sequence == root { stem } else { format!("{}/{stem}", id(root, &self.sequence)) }
    }

    /// Reads both; the depth map holds `units_per_metre` units a metre.
    pub(super) fn read(&self, units_per_metre: f64) -> Result<Read> {
        let image = read_image(&self.image)?.pixels;
        let options = ReadOptions { png_scale: Some(units_per_metre), ..ReadOptions::default() };
        let depth = read_depth(&self.depth, &options)?;
        let (height, width, _) = image.dim();
        same_size(&self.depth, depth.dim(), (height, width))?;
        Ok((image, depth, [width, height]))
    }
}

/// Pairs with their identifiers: what the data sets of sequences have in common.
#[derive(Debug, Clone)]
pub(super) struct Paired {
    pub(super) pairs: Vec<Pair>,
    pub(super) ids: Vec<String>,
    /// The place of each pair.
    places: Vec<String>,
}

impl Paired {
    /// `recorded` is whether a pair is a frame of a recording, whose frames show one place.
    pub(super) fn new(root: &Path, pairs: Vec<Pair>, recorded: impl Fn(&Pair) -> bool) -> Self {
        let ids: Vec<String> = pairs.iter().map(|pair| pair.id(root)).collect();
        let place = |(pair, own): (&Pair, &String)| match recorded(pair) {
            true => id(root, &pair.sequence),
            false => own.clone(),
        };
        Self { places: pairs.iter().zip(&ids).map(place).collect(), pairs, ids }
    }

    pub(super) fn place(&self, index: usize) -> Option<&str> {
        self.places.get(index).map(String::as_str)
    }

    /// Every `stride`-th pair, from the first.
    pub(super) fn step(&mut self, stride: usize) {
        let stride = stride.max(1);
        self.pairs = self.pairs.drain(..).step_by(stride).collect();
        self.ids = self.ids.drain(..).step_by(stride).collect();
        self.places = self.places.drain(..).step_by(stride).collect();
    }

    pub(super) fn get(&self, index: usize) -> Result<(&Pair, &String)> {
        match (self.pairs.get(index), self.ids.get(index)) {
            (Some(pair), Some(id)) => Ok((pair, id)),
            _ => Err(out_of_range(index, self.pairs.len())),
        }
    }

    /// A sample whose camera depends on the image's width and height alone.
    pub(super) fn load(
        &self,
        index: usize,
        units_per_metre: f64,
        trusted_depth: f64,
        camera: impl Fn(&Pair, [usize; 2]) -> Result<(PinholeCamera, bool)>,
    ) -> Result<Sample> {
        let (pair, id) = self.get(index)?;
        let (image, depth, size) = pair.read(units_per_metre)?;
        let (camera, assumed_camera) = camera(pair, size)?;
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
