//! The inputs of a refinement, as the caller gives them and at the size at which they are refined.

use super::one_scale::{Factor, same_scale};
use super::{Motion, Watch};
use crate::error::{message, raise};
use crate::settings::Settings;
use mde_cli::inputs::size::{SMALLEST, shrink, within, working};
use mde_cli::inputs::{CameraSource, GivenCamera, Known, KnownCamera};
use mde_cli::mde_prior::DepthPrior;
use mde_cli::mde_prior::resample::nearest;
use mde_cli::mde_warp::Pose;
use mde_cli::memory::{MemoryLimit, PhotographMemory, capture_bytes};
use mde_cli::nalgebra::{Quaternion, Translation3, UnitQuaternion};
use mde_cli::results::{SameScale, Unit};
use mde_cli::scale::KnownDepth;
use mde_cli::{Capture, Config, Naming, Photograph, Preset};
use ndarray::{Array2, Array3};
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;

/// A photograph as the caller gave it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct Given<'py> {
    name: String,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    /// Focal length of its EXIF in millimetres of 35 mm film.
    focal: Option<f64>,
    /// fx, fy, cx, cy in pixels.
    intrinsics: Option<[f64; 4]>,
    /// Where the image has content; everywhere without it.
    mask: Option<PyReadonlyArray2<'py, bool>>,
    /// World to camera.
    pose: Option<Motion>,
}

/// Depths that give the scale.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Scale<'py> {
    /// The file or folder; an array without it.
    path: Option<PathBuf>,
    /// Rows of column, row, depth, sigma.
    rows: PyReadonlyArray2<'py, f64>,
    /// The file of the photograph.
    photograph: PathBuf,
}

/// Arguments of [`refine`](super::refine).
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Arguments<'py> {
    /// The first is refined.
    photographs: Vec<Given<'py>>,
    /// Horizontal field of view of those without intrinsics, degrees.
    fov: Option<f64>,
    /// The file that the intrinsics are from.
    camera_file: Option<String>,
    /// Whether the results are in the unit of the poses.
    unit_of_poses: bool,
    scale_from: Option<Scale<'py>>,
    /// The factor to one scale with other photographs.
    same_scale: Option<Factor>,
    /// Whether the fitted field is a part of the result.
    keep_field: bool,
    max_size: Option<usize>,
    /// Million pixels.
    work_size: f64,
    /// GiB.
    max_memory: f64,
    pub(super) threads: Option<usize>,
}

/// A photograph and its camera.
pub(super) struct Input {
    pub(super) name: String,
    image: Array3<f32>,
    mask: Option<Array2<bool>>,
    known: KnownCamera,
    pose: Option<Pose>,
}

pub(super) struct Inputs {
    pub(super) photographs: Vec<Input>,
    pub(super) unit: Unit,
    pub(super) scale: Option<Known>,
    pub(super) same_scale: Option<SameScale>,
    pub(super) keep_field: bool,
    max_size: Option<usize>,
    work_size: f64,
    limit: MemoryLimit,
}

/// A photograph at the size at which it is refined.
pub(super) struct Opened {
    name: String,
    /// `(height, width)` as given.
    pub(super) original: (usize, usize),
    /// `(height, width)` of the refinement.
    pub(super) size: (usize, usize),
    pub(super) image: Array3<f32>,
    mask: Array2<bool>,
    /// Of the original size.
    pub(super) known: KnownCamera,
    pose: Option<Pose>,
    /// At the size of the results, where that is larger.
    pub(super) full: Option<Array3<f32>>,
}

/// The camera of a photograph with these arguments.
pub(crate) fn given(intrinsics: Option<[f64; 4]>, fov: Option<f64>) -> GivenCamera {
    match (intrinsics, fov) {
        (Some([fx, fy, cx, cy]), _) => {
            GivenCamera::Intrinsics { fx, fy: Some(fy), cx: Some(cx), cy: Some(cy) }
        }
        (None, Some(fov)) => GivenCamera::FieldOfView(fov),
        (None, None) => GivenCamera::Nothing,
    }
}

impl Inputs {
    pub(super) fn new(arguments: Arguments<'_>) -> PyResult<Self> {
        for (name, value, unit) in [
            ("work_size", arguments.work_size, "million pixels"),
            ("max_memory", arguments.max_memory, "GiB"),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(raise(format!("{name} is {value}; give a positive number of {unit}")));
            }
        }
        if arguments.max_size.is_some_and(|side| side < SMALLEST) {
            return Err(raise(format!("max_size is too small; give {SMALLEST} pixels or more")));
        }
        let photographs = arguments.photographs.iter().map(|one| {
            let name = one.name.clone();
            let image = one.image.as_array().to_owned();
            check(&name, &image)?;
            if one.intrinsics.is_some() && arguments.fov.is_some() {
                return Err(raise("intrinsics and fov are both given; give one of them"));
            }
            let (height, width, _) = image.dim();
            let camera = given(one.intrinsics, arguments.fov);
            let mut known =
                KnownCamera::new(&camera, one.focal, [width, height], Naming::Keywords).map_err(raise)?;
            if let Some(file) = &arguments.camera_file {
                known.source = CameraSource::File(file.clone());
            }
            let mask = one.mask.as_ref().map(|mask| mask.as_array().to_owned());
            let pose = one.pose.map(|[w, i, j, k, x, y, z]| {
                let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
                Pose::from_parts(Translation3::new(x, y, z), rotation)
            });
            Ok(Input { name, image, mask, known, pose })
        });
        let photographs = photographs.collect::<PyResult<Vec<_>>>()?;
        let scale = match (&arguments.scale_from, photographs.first()) {
            (Some(scale), Some(first)) => Some(scale.open(first)?),
            _ => None,
        };
        let unit = if arguments.unit_of_poses { Unit::Capture } else { Unit::Prior };
        let limit = MemoryLimit { gib: arguments.max_memory, naming: Naming::Keywords };
        let same_scale = arguments.same_scale.map(same_scale);
        let Arguments { max_size, work_size, keep_field, .. } = arguments;
        Ok(Self { photographs, unit, scale, same_scale, keep_field, max_size, work_size, limit })
    }

    /// The photographs at the size at which they are refined.
    pub(super) fn open(&self, settings: &Settings, watch: &mut Watch<'_>) -> Result<Vec<Opened>, String> {
        let several = self.photographs.len() > 1;
        let mut opened = Vec::new();
        for Input { name, image, mask, known, pose } in &self.photographs {
            let (height, width, _) = image.dim();
            let size = within((height, width), self.max_size);
            let at = working(size, self.work_size);
            let mut image = Cow::Borrowed(image);
            if size != (height, width) {
                image = Cow::Owned(shrink(&image, size));
                let text = format!("{name}: resized from {width}x{height} to {}x{} pixels", size.1, size.0);
                watch.warnings.push(text);
            }
            if at != size {
                let text = format!(
                    "{}x{} pixels: refined at {}x{}; work_size sets this",
                    size.1, size.0, at.1, at.0
                );
                watch.warnings.push(text);
            }
            // That of one photograph is brought back to its own size.
            let full = (at != size && !several).then(|| image.clone().into_owned());
            let image = if at == size { image.into_owned() } else { shrink(&image, at) };
            let everywhere = || Array2::from_elem((height, width), true);
            let mut mask = mask.clone().unwrap_or_else(everywhere);
            if at != (height, width) {
                mask = nearest(mask.view(), at);
            }
            let (name, known, original) = (name.clone(), known.clone(), (height, width));
            opened.push(Opened { name, original, size: at, image, mask, known, pose: *pose, full });
        }
        if let Some(first) = opened.first().filter(|_| several) {
            let (count, threads) = (opened.len() as u64, rayon::current_num_threads() as u64);
            let bytes = |pixels| capture_bytes(pixels, count, threads, &settings.config);
            self.limit.check(&format!("views: {count} photographs"), first.size, bytes).map_err(message)?;
        }
        Ok(opened)
    }

    /// The prior's predictions at once that the memory limit allows for one photograph.
    pub(super) fn predictions_at_once(
        &self,
        one: &Opened,
        config: &Config,
        prior: &dyn DepthPrior,
    ) -> Result<usize, String> {
        let full = one.full.as_ref().map_or(one.size, |full| (full.dim().0, full.dim().1));
        let memory = PhotographMemory::new(config, prior, full, one.size, rayon::current_num_threads());
        memory.predictions_at_once(&self.limit, &one.name, one.size).map_err(message)
    }

    /// The same for several photographs, which are predicted side by side.
    pub(super) fn predictions_at_once_of(
        &self,
        opened: &[Opened],
        prior: &dyn DepthPrior,
    ) -> Result<usize, String> {
        let Some(first) = opened.first() else { return Ok(1) };
        let (config, threads) = (Preset::Default.config(), rayon::current_num_threads());
        let count = opened.len();
        let memory = PhotographMemory::of_several(&config, prior, first.size, count, threads);
        memory
            .predictions_at_once(&self.limit, &format!("views: {count} photographs"), first.size)
            .map_err(message)
    }
}

impl Scale<'_> {
    /// The known depths of a photograph.
    fn open(&self, first: &Input) -> PyResult<Known> {
        let (height, width, _) = first.image.dim();
        let size = (height, width);
        if let Some(path) = &self.path {
            return Known::open(path, &self.photograph, size, Naming::Keywords).map_err(raise);
        }
        let rows = self.rows.as_array();
        let depths = rows.rows().into_iter().filter_map(|row| {
            let [x, y, depth, sigma] = row.to_vec().try_into().ok()?;
            Some(KnownDepth { x, y, depth, sigma })
        });
        let naming = Naming::Keywords;
        Known::new("array".to_owned(), depths.collect(), &first.name, size, naming).map_err(raise)
    }
}

/// Refuses an image that is none.
fn check(name: &str, image: &Array3<f32>) -> PyResult<()> {
    let (height, width, channels) = image.dim();
    if channels != 3 {
        return Err(raise(format!("{name}: the image has {channels} channels; give [height, width, 3]")));
    }
    if height.min(width) < SMALLEST {
        return Err(raise(format!(
            "{name}: the image is {width}x{height}; give one of {SMALLEST}x{SMALLEST} pixels or more"
        )));
    }
    match image.iter().find(|value| !(0.0..=1.0).contains(*value)) {
        Some(value) => Err(raise(format!("{name}: the image holds {value}; give 0 to 1, or bytes (uint8)"))),
        None => Ok(()),
    }
}

pub(super) fn capture(opened: &[Opened]) -> Result<Capture, String> {
    let photograph = |opened: &Opened| -> Result<Photograph, String> {
        let known = opened.known.resized(opened.size).map_err(message)?;
        Ok(Photograph {
            name: opened.name.clone(),
            image: opened.image.clone(),
            mask: opened.mask.clone(),
            camera: known.camera,
            focal_assumed: known.is_assumed() && opened.pose.is_none(),
            pose: opened.pose,
        })
    };
    let photographs = opened.iter().map(photograph).collect::<Result<_, _>>()?;
    let capture = Capture { photographs, reference: 0 };
    capture.validate().map_err(message)?;
    Ok(capture)
}
