//! The inputs of a refinement, as the caller gives them and at the size at which they are refined.

use super::one_scale::{Factor, same_scale};
use super::{Motion, Watched, pose_of};
use crate::error::raise;
use crate::prior::Linked;
use crate::settings::Settings;
use mde_cli::mde_prior::resample::nearest;
use mde_cli::mde_warp::Pose;
use mde_cli::naming::Naming;
use mde_cli::prior::bound::BoundPrior;
use mde_cli::refinement::scale::KnownDepth;
use mde_cli::refiner::finish::{SameScale, Unit};
use mde_cli::refiner::plan::capture_bytes;
use mde_cli::refiner::plan::limit::MemoryLimit;
use mde_cli::refiner::run::Watch;
use mde_cli::scene::camera::{CameraSource, GivenCamera, KnownCamera};
use mde_cli::scene::known::Known;
use mde_cli::scene::photograph::{Opened, Sizes};
use mde_cli::scene::size::SMALLEST;
use mde_cli::several::{Capture, Photograph};
use ndarray::{Array2, Array3};
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
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

/// A photograph, its camera and its place.
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
    sizes: Sizes,
    limit: MemoryLimit,
}

/// A photograph at the size at which it is refined, with the others' view of it.
pub(super) struct Placed {
    name: String,
    pub(super) opened: Opened,
    mask: Array2<bool>,
    pose: Option<Pose>,
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
            let pose = one.pose.map(pose_of);
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
        let sizes = Sizes { longest: arguments.max_size, megapixels: arguments.work_size };
        let keep_field = arguments.keep_field;
        Ok(Self { photographs, unit, scale, same_scale, keep_field, sizes, limit })
    }

    /// The photographs at their sizes, the prior for the first with the camera that it gives, and its predictions at once.
    pub(super) fn open<'p>(
        &self,
        settings: &Settings,
        prior: &'p Linked<'p>,
        watch: &mut Watched<'_>,
    ) -> mde_cli::error::Result<(Vec<Placed>, BoundPrior<'p>, usize)> {
        let several = self.photographs.len() > 1;
        let mut placed = Vec::new();
        for Input { name, image, mask, known, pose } in &self.photographs {
            let mut warn = |warning: String| {
                watch.warn(if several { format!("{name}: {warning}") } else { warning });
            };
            let opened = Opened::new(image.clone(), known.clone());
            let opened = opened.resized(name, &self.sizes, several, Naming::Keywords, &mut warn)?;
            let mask = match mask {
                Some(mask) if mask.dim() == opened.size() => mask.clone(),
                Some(mask) => nearest(mask.view(), opened.size()),
                None => Array2::from_elem(opened.size(), true),
            };
            placed.push(Placed { name: name.clone(), opened, mask, pose: *pose });
        }
        let count = placed.len();
        let Some(Placed { name, opened: first, .. }) = placed.first_mut() else {
            return Err(mde_cli::error::Error::Argument("there is no photograph; give one".to_owned()));
        };
        if several {
            let (photographs, threads) = (count as u64, rayon::current_num_threads() as u64);
            let bytes = |pixels| capture_bytes(pixels, photographs, threads, &settings.config);
            self.limit.check(&format!("views: {count} photographs"), first.size(), bytes)?;
        }
        let bound = prior.bind(first, &mut |warning| watch.warn(warning))?;
        let at_once = match several {
            true => first.predictions_at_once_of(count, &bound, &self.limit)?,
            false => first.predictions_at_once(name, &settings.config, &bound, &self.limit)?,
        };
        // Further photographs give the focal length.
        if !several {
            let origin = bound.origin().clone();
            first.take_camera_of(&bound, &origin)?;
        }
        let bound = bound.at_focal(first.camera.focal());
        Ok((placed, bound, at_once))
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

pub(super) fn capture(placed: &[Placed]) -> mde_cli::error::Result<Capture> {
    let photograph = |placed: &Placed| Photograph {
        name: placed.name.clone(),
        image: placed.opened.image.clone(),
        mask: placed.mask.clone(),
        camera: placed.opened.camera.camera,
        focal_assumed: placed.opened.camera.is_assumed() && placed.pose.is_none(),
        pose: placed.pose,
    };
    let capture = Capture {
        photographs: placed.iter().map(photograph).collect(),
        reference: 0,
        matches: None,
        points: Vec::new(),
    };
    capture.validate()?;
    Ok(capture)
}
