//! The inputs of a refinement, as the caller gives them, and the scene that they are.

use super::Watched;
use super::one_scale::{Factor, same_scale_of};
use crate::error::raise;
use mde_cli::error::{Error, Result};
use mde_cli::mde_mvs::capture::CaptureFiles;
use mde_cli::mde_prior::photo::image_size;
use mde_cli::mde_warp::Pose;
use mde_cli::nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use mde_cli::refiner::capture::scene_of;
use mde_cli::refiner::{Observer as _, Plan, Refiner};
use mde_cli::scene::camera::{GivenCamera, KnownCamera};
use mde_cli::scene::known::{KnownDepth, KnownDepths};
use mde_cli::scene::{Photograph, SameScale, Scene};
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use std::path::PathBuf;

/// What is given of a camera.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Camera {
    /// A file of intrinsics.
    file: Option<PathBuf>,
    /// fx, fy, cx, cy in pixels.
    intrinsics: Option<[f64; 4]>,
    /// Horizontal field of view, degrees.
    fov: Option<f64>,
}

impl Camera {
    fn given(self) -> GivenCamera {
        match (self.file, self.intrinsics, self.fov) {
            (Some(path), ..) => GivenCamera::File(path),
            (None, Some([fx, fy, cx, cy]), _) => {
                GivenCamera::Intrinsics { fx, fy: Some(fy), cx: Some(cx), cy: Some(cy) }
            }
            (None, None, Some(fov)) => GivenCamera::FieldOfView(fov),
            (None, None, None) => GivenCamera::Nothing,
        }
    }

    /// The camera of an image of `(height, width)` without EXIF.
    pub(crate) fn of(self, (height, width): (usize, usize)) -> PyResult<KnownCamera> {
        KnownCamera::new(&self.given(), None, [width, height]).map_err(raise)
    }
}

/// A photograph as the caller gave it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Given<'py> {
    name: String,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    /// Focal length of its EXIF in millimetres of 35 mm film.
    focal: Option<f64>,
    /// World to camera.
    pose: Option<[[f64; 4]; 4]>,
}

/// A capture with poses, in the files of another program.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Capture {
    path: PathBuf,
    /// Its photograph that is refined with the nearest; none for all of them.
    image: Option<PathBuf>,
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

/// The inputs of a refinement.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Arguments<'py> {
    /// Name of what is refined, for the record.
    input: String,
    /// The first is the reference.
    photographs: Vec<Given<'py>>,
    /// Names of further ones that can't be read, and why.
    unreadable: Vec<(String, String)>,
    /// In the place of these.
    capture: Option<Capture>,
    camera: Camera,
    scale_from: Option<Scale<'py>>,
    /// The factor to one scale with other photographs.
    same_scale: Option<Factor>,
    pub(super) threads: Option<usize>,
}

/// The inputs without the interpreter.
pub(super) struct Inputs {
    pub(super) input: String,
    photographs: Vec<Photograph>,
    unreadable: Vec<(String, String)>,
    capture: Option<Capture>,
    camera: GivenCamera,
    known: Option<KnownDepths>,
    same_scale: Option<SameScale>,
}

impl Inputs {
    pub(super) fn new(arguments: Arguments<'_>) -> PyResult<Self> {
        let Arguments { input, unreadable, capture, .. } = arguments;
        let camera = arguments.camera.given();
        let given = arguments.photographs.into_iter().enumerate().map(|(index, one)| {
            let image = one.image.as_array().to_owned();
            if let Some(value) = image.iter().find(|value| !(0.0..=1.0).contains(*value)) {
                let name = one.name;
                return Err(raise(format!("{name}: the image holds {value}; give 0 to 1, or bytes (uint8)")));
            }
            let (height, width, _) = image.dim();
            let camera = KnownCamera::new(&camera, one.focal, [width, height]).map_err(raise)?;
            let pose = one.pose.map(|rows| rigid(&format!("poses[{index}]"), &rows)).transpose()?;
            Ok(Photograph { pose, ..Photograph::new(one.name, image, camera) })
        });
        let photographs = given.collect::<PyResult<Vec<_>>>()?;
        let known = arguments.scale_from.map(|scale| {
            let of_capture = capture.as_ref().and_then(|capture| image_size(capture.image.as_deref()?));
            let size = of_capture.map(|[width, height]| (height, width));
            scale.known(size.or_else(|| Some(photographs.first()?.original)).unwrap_or_default())
        });
        let same_scale = arguments.same_scale.map(same_scale_of);
        let known = known.transpose().map_err(raise)?;
        Ok(Self { input, photographs, unreadable, capture, camera, known, same_scale })
    }

    /// The photographs at their sizes, with what gives their scale, and the plan.
    pub(super) fn scene(self, refiner: &Refiner<'_>, watch: &mut Watched<'_>) -> Result<(Scene, Plan)> {
        let Self { photographs, unreadable, capture, camera, known, same_scale, .. } = self;
        let (scene, plan) = match capture {
            Some(Capture { path, image }) => {
                let shown = path.display();
                let files = CaptureFiles::find(&path).ok_or_else(|| {
                    Error::Argument(format!("{{views}} {shown}: holds no capture; check the path"))
                })?;
                refiner.capture((&files, &path), image.as_deref(), &camera, watch)?
            }
            None => given(photographs, unreadable, refiner, watch)?,
        };
        Ok((Scene { known, same_scale, ..scene }, plan))
    }
}

impl Scale<'_> {
    /// The known depths of a photograph of `(height, width)`.
    fn known(self, size: (usize, usize)) -> Result<KnownDepths> {
        let Self { path, rows, photograph } = self;
        if let Some(path) = path {
            return KnownDepths::open(&path, &photograph, size);
        }
        let rows = rows.as_array();
        let depths = rows.rows().into_iter().filter_map(|row| {
            let [x, y, depth, sigma] = row.to_vec().try_into().ok()?;
            Some(KnownDepth { x, y, depth, sigma })
        });
        KnownDepths::new("array".to_owned(), depths.collect(), &photograph.display().to_string(), size)
    }
}

fn given(
    photographs: Vec<Photograph>,
    unreadable: Vec<(String, String)>,
    refiner: &Refiner<'_>,
    watch: &mut Watched<'_>,
) -> Result<(Scene, Plan)> {
    let count = photographs.len() + unreadable.len();
    let Some(Photograph { name, original, .. }) = photographs.first() else {
        return Err(Error::Argument("there is no photograph; give one".to_owned()));
    };
    let several = count > 1;
    let what = if several { format!("{{views}}: {count} photographs") } else { name.clone() };
    let plan = refiner.plan(&what, *original, count)?;
    let resized = photographs.into_iter().map(|one| {
        let name = one.name.clone();
        let mut warn = |text: String| watch.warn(if several { format!("{name}: {text}") } else { text });
        one.resized(&refiner.settings().sizes, several, &mut warn)
    });
    let mut photographs = resized.collect::<Result<Vec<_>>>()?;
    if !several {
        return Ok((Scene::one(photographs.remove(0)), plan));
    }
    Ok((scene_of(photographs, unreadable, watch)?.0, plan))
}

/// Whether a path holds a capture with poses.
#[pyfunction]
pub(crate) fn is_capture(path: PathBuf) -> bool {
    CaptureFiles::find(&path).is_some()
}

/// The rigid motion of a 4x4 matrix; `name` is that of the argument.
pub(crate) fn rigid(name: &str, rows: &[[f64; 4]; 4]) -> PyResult<Pose> {
    let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).norm();
    let last = rows[3] == [0.0, 0.0, 0.0, 1.0];
    if !last || off > 1e-3 || rotation.determinant() < 0.0 || rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(raise(format!(
            "{name}: no rigid motion; give a rotation, a translation and the last row 0, 0, 0, 1"
        )));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(Pose::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation))
}
