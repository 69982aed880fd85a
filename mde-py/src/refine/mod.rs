//! The refinement: one photograph, or several of one scene.

pub(crate) mod camera;
mod record;
mod size;

use crate::error::{message, raise};
use crate::prior::{Origin, Prior};
use crate::settings::Settings;
use crate::worker::{self, Link, Request};
use camera::{CameraSource, KnownCamera};
use mde_cli::capture::Origin as DepthOrigin;
use mde_cli::mde_prior::DepthKind;
use mde_cli::mde_prior::augment::Predictions;
use mde_cli::mde_prior::resample::nearest;
use mde_cli::mde_warp::{PinholeCamera, Pose};
use mde_cli::nalgebra::{Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use mde_cli::pictures16::{DepthPng, METRES};
use mde_cli::{
    Capture, CaptureReport, Config, Event, Photograph, Refinement, Stages, refine as refine_one,
    refine_capture,
};
use ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use record::{Record, TrainingCurve, doubts, follow};
use size::{SMALLEST, bytes, shrink, thumbnail, within, working};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

/// A photograph as the caller gave it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Given<'py> {
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

/// A rotation as quaternion w, x, y, z, then a translation: a matrix would lose bits.
pub(crate) type Motion = [f64; 7];

/// Arguments of [`refine`].
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
    max_size: Option<usize>,
    /// Million pixels.
    work_size: f64,
    threads: Option<usize>,
}

/// A photograph and its camera.
struct Input {
    name: String,
    image: Array3<f32>,
    mask: Option<Array2<bool>>,
    known: KnownCamera,
    pose: Option<Pose>,
}

struct Inputs {
    photographs: Vec<Input>,
    unit_of_poses: bool,
    max_size: Option<usize>,
    work_size: f64,
}

/// What a run gives back.
struct Outcome {
    refinement: Maps,
    image: Array3<f32>,
    camera: PinholeCamera,
    run: String,
    config: String,
    warnings: Vec<String>,
    pictures: Vec<(String, Array3<u8>)>,
    evidence: Option<[Array2<f32>; 3]>,
}

struct Maps {
    depth: Array2<f32>,
    variance: Array2<f32>,
    sigma: Array2<f32>,
    prior: Array2<f32>,
    components: Vec<(&'static str, Array2<f32>)>,
}

/// Refines the depth of the first photograph. The result is a dictionary of its parts.
#[pyfunction]
#[pyo3(signature = (prior, settings, arguments, model, progress))]
pub(crate) fn refine<'py>(
    py: Python<'py>,
    prior: &Prior,
    settings: &Settings,
    arguments: Arguments<'py>,
    model: Option<Object<'py>>,
    progress: Option<Object<'py>>,
) -> PyResult<Object<'py>> {
    let threads = arguments.threads;
    let inputs = Inputs::new(arguments)?;
    let observed = progress.is_some();
    let serve = |request| match request {
        Request::Progress(stage, done, total) => match &progress {
            Some(progress) => progress.call1((stage, done, total)).map(drop),
            None => Ok(()),
        },
        Request::Predict(image, reply) => {
            let Some(model) = &model else { return Err(raise("the prior is a callable, but there is none")) };
            let depth = model.call1((image.into_pyarray(py),))?;
            let depth = depth.cast::<PyArray2<f32>>()?.readonly().as_array().to_owned();
            // Without a receiver the work is cancelled.
            let _ = reply.send(depth);
            Ok(())
        }
    };
    let outcome = worker::run(py, threads, serve, |link| work(link, prior, settings, inputs, observed))?;
    outcome.into_dict(py)
}

/// Any Python object.
type Object<'py> = pyo3::Bound<'py, PyAny>;

impl Inputs {
    fn new(arguments: Arguments<'_>) -> PyResult<Self> {
        if !(arguments.work_size > 0.0 && arguments.work_size.is_finite()) {
            return Err(raise(format!(
                "work_size is {}; give a positive number of million pixels",
                arguments.work_size
            )));
        }
        if arguments.max_size.is_some_and(|side| side < SMALLEST) {
            return Err(raise(format!("max_size is too small; give {SMALLEST} pixels or more")));
        }
        let photographs = arguments.photographs.iter().map(|given| {
            let name = given.name.clone();
            let image = given.image.as_array().to_owned();
            check(&name, &image)?;
            let camera = match (given.intrinsics, arguments.fov) {
                (Some(_), Some(_)) => {
                    return Err(raise("intrinsics and fov are both given; give one of them"));
                }
                (Some(intrinsics), None) => camera::Given::Intrinsics(intrinsics),
                (None, Some(fov)) => camera::Given::FieldOfView(fov),
                (None, None) => camera::Given::Nothing,
            };
            let (height, width, _) = image.dim();
            let mut known = KnownCamera::new(camera, given.focal, height, width).map_err(raise)?;
            if let Some(file) = &arguments.camera_file {
                known.source = CameraSource::File(file.clone());
            }
            let mask = given.mask.as_ref().map(|mask| mask.as_array().to_owned());
            let pose = given.pose.map(|[w, i, j, k, x, y, z]| {
                let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
                Pose::from_parts(Translation3::new(x, y, z), rotation)
            });
            Ok(Input { name, image, mask, known, pose })
        });
        Ok(Self {
            photographs: photographs.collect::<PyResult<_>>()?,
            unit_of_poses: arguments.unit_of_poses,
            max_size: arguments.max_size,
            work_size: arguments.work_size,
        })
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

/// The numbers of a pose.
pub(crate) fn motion(pose: &Pose) -> Motion {
    let (q, t) = (pose.rotation, pose.translation);
    [q.w, q.i, q.j, q.k, t.x, t.y, t.z]
}

/// The numbers of a 4x4 matrix; `name` is that of the argument.
#[pyfunction]
#[pyo3(signature = (name, rows))]
pub(crate) fn rigid_motion(name: &str, rows: [[f64; 4]; 4]) -> PyResult<Motion> {
    Ok(motion(&rigid(name, &rows)?))
}

/// The rigid motion of a 4x4 matrix.
pub(crate) fn rigid(name: &str, rows: &[[f64; 4]; 4]) -> PyResult<Pose> {
    let fault = || {
        raise(format!("{name}: no rigid motion; give a rotation, a translation and the last row 0, 0, 0, 1"))
    };
    let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).norm();
    let last = rows[3] == [0.0, 0.0, 0.0, 1.0];
    if !last || off > 1e-3 || rotation.determinant() < 0.0 || rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(fault());
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(Pose::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation))
}

/// The state of a run beside its inputs.
struct Watch<'l> {
    link: &'l Link,
    observed: bool,
    iteration: usize,
    training: Vec<TrainingCurve>,
    warnings: Vec<String>,
}

impl Watch<'_> {
    fn observe(&mut self, event: &Event) -> ControlFlow<()> {
        let seen = match event {
            Event::Begin { stage, iteration, .. } => {
                self.iteration = *iteration;
                Some((stage.name(), 0, 0))
            }
            Event::Predicted { done, total } => Some(("prior", *done, *total)),
            Event::Field { event, view, views } => {
                follow(&mut self.training, self.iteration, event);
                match *event {
                    mde_cli::mde_nerf::FieldEvent::Fit { step, steps, .. } => Some(("fit", step, steps)),
                    mde_cli::mde_nerf::FieldEvent::Render { row, rows } => {
                        Some(("render", view * rows + row, views * rows))
                    }
                    _ => None,
                }
            }
            _ => None,
        };
        if let Some((stage, done, total)) = seen.filter(|_| self.observed) {
            self.link.send(Request::Progress(stage, done, total));
        }
        match self.link.is_cancelled() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

fn work(
    link: &Link,
    prior: &Prior,
    settings: &Settings,
    inputs: Inputs,
    observed: bool,
) -> Result<Outcome, String> {
    let start = Instant::now();
    let mut watch = Watch { link, observed, iteration: 0, training: Vec::new(), warnings: Vec::new() };
    let several = inputs.photographs.len() > 1;
    let mut opened = Vec::new();
    for Input { name, image, mask, known, pose } in &inputs.photographs {
        let (height, width, _) = image.dim();
        let size = within((height, width), inputs.max_size);
        let at = working(size, inputs.work_size);
        let mut image = std::borrow::Cow::Borrowed(image);
        if size != (height, width) {
            image = std::borrow::Cow::Owned(shrink(&image, size));
            watch
                .warnings
                .push(format!("{name}: resized from {width}x{height} to {}x{} pixels", size.1, size.0));
        }
        if at != size {
            let text =
                format!("{}x{} pixels: refined at {}x{}; work_size sets this", size.1, size.0, at.1, at.0);
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
        let (name, known) = (name.clone(), known.clone());
        opened.push(Opened {
            name,
            original: (height, width),
            size: at,
            image,
            mask,
            known,
            pose: *pose,
            full,
        });
    }
    let config = &settings.config;
    let mut known = opened[0].known.resized(opened[0].size).map_err(message)?;
    if known.is_assumed()
        && !several
        && let Some([fx, fy, cx, cy]) = prior.camera(opened[0].image.view()).map_err(message)?
    {
        let (height, width) = opened[0].size;
        let camera = PinholeCamera::new(fx, fy, cx, cy, width, height).map_err(message)?;
        known = KnownCamera { camera, source: CameraSource::Network };
        opened[0].known = known.resized(opened[0].original).map_err(message)?;
    }
    let first = &opened[0];
    let origin = prior.origin(known.focal());
    let (bound, warning) = prior.bind(link, first.original, first.size, known.focal()).map_err(message)?;
    watch.warnings.extend(warning);
    let mut stages = Stages::new(&bound);
    if let Some(budget) = settings.budget {
        stages = stages.with_budget(budget);
    }
    if known.is_assumed() && !several {
        watch.warnings.push(
            "the camera is unknown: a horizontal field of view of 60 degrees is assumed, which affects the point cloud but not the \
             depth, unless a field is fitted; give intrinsics or fov"
                .to_owned(),
        );
    }
    let capture = several.then(|| photographs(&opened)).transpose()?;
    let mut observe = |event: &Event| watch.observe(event);
    let refined = match &capture {
        Some(capture) => refine_capture(capture, stages, config, &mut observe),
        None => refine_one(first.image.view(), &known.camera, stages, config, &mut observe),
    };
    let mut refinement = refined.map_err(message)?;
    let mut image = first.image.view();
    if let Some(full) = &first.full {
        refinement = refinement.upsampled(image, full.view()).map_err(message)?;
        let (height, width, _) = full.dim();
        (image, known) = (full.view(), first.known.resized((height, width)).map_err(message)?);
    }
    if let Some(report) = &refinement.capture {
        if let Some(reason) = &report.fallback {
            watch.warnings.push(format!("views: {reason}; only the reference photograph was used"));
        } else if let Some(camera) = report.photographs.first().and_then(|found| found.camera)
            && camera != known.camera
        {
            known = KnownCamera { camera, source: CameraSource::Estimated };
        }
        if inputs.unit_of_poses {
            refinement = refinement.in_capture_unit().map_err(message)?;
        }
    }
    let seconds = (start.elapsed().as_secs_f64(), bound.seconds());
    finished(
        Finished { prior, origin, settings, watch, refinement, known, capture, seconds },
        image.to_owned(),
        &inputs,
    )
}

/// A photograph at the size at which it is refined.
struct Opened {
    name: String,
    /// `(height, width)` as given.
    original: (usize, usize),
    /// `(height, width)` of the refinement.
    size: (usize, usize),
    image: Array3<f32>,
    mask: Array2<bool>,
    /// Of the original size.
    known: KnownCamera,
    pose: Option<Pose>,
    /// At the size of the results, where that is larger.
    full: Option<Array3<f32>>,
}

fn photographs(opened: &[Opened]) -> Result<Capture, String> {
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

struct Finished<'f> {
    prior: &'f Prior,
    origin: Origin,
    settings: &'f Settings,
    watch: Watch<'f>,
    refinement: Refinement,
    known: KnownCamera,
    capture: Option<Capture>,
    /// Of the run, and of the predictions.
    seconds: (f64, f64),
}

fn finished(done: Finished<'_>, image: Array3<f32>, inputs: &Inputs) -> Result<Outcome, String> {
    let Finished { prior, origin, settings, mut watch, refinement, known, capture, seconds } = done;
    let config = &settings.config;
    if !prior.is_map() {
        watch.warnings.extend(doubts(&refinement.prior, &origin, config));
    }
    if let Some(reason) = refinement.augmentation.skipped {
        watch.warnings.push(format!("no test-time augmentation: {reason}; give a model to use it"));
    }
    for (index, iteration) in refinement.iterations.iter().enumerate() {
        let warnings = iteration.fusion.warnings.iter();
        watch.warnings.extend(warnings.map(|warning| format!("iteration {}: {warning}", index + 1)));
    }
    let unit = match origin.kind {
        _ if inputs.unit_of_poses => "capture",
        DepthKind::Metric => METRES,
        _ => "unscaled",
    };
    let png = DepthPng::new(unit, refinement.depth.mean().iter().copied());
    watch.warnings.extend(png.warning());
    let record = Record {
        command: "refine",
        versions: BTreeMap::from([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]),
        input: &inputs.photographs[0].name,
        camera: &known,
        preset: settings.preset.name(),
        seed: config.seed,
        threads: rayon::current_num_threads(),
        warnings: &watch.warnings,
        total_seconds: seconds.0,
        prior: &origin,
        unit,
        png_scale: png.scale,
        png_missing_pixels: png.beyond,
        missing_pixels: refinement.depth.variance().iter().filter(|v| v.is_infinite()).count(),
        augmentation: &refinement.augmentation,
        capture: refinement.capture.as_ref(),
        iterations: &refinement.iterations,
        training: &watch.training,
        prior_seconds: seconds.1,
    };
    let run = serde_json::to_string(&record).map_err(message)?;
    let sigma = refinement.depth.sigma();
    let (pictures, evidence) = match (&capture, &refinement.capture) {
        (Some(capture), Some(report)) => (pictures(capture, report), evidence(report)),
        _ => (Vec::new(), None),
    };
    let (depth, variance) = refinement.depth.into_parts();
    let mut config = config.clone();
    if settings.budget.is_some() {
        // The clock chose the number; with it the run repeats.
        config.augmentation.predictions = Predictions::Most(refinement.augmentation.predictions as u32);
    }
    Ok(Outcome {
        image,
        camera: known.camera,
        run,
        config: toml(&config)?,
        warnings: watch.warnings,
        pictures,
        evidence,
        refinement: Maps {
            depth,
            variance,
            sigma,
            prior: refinement.prior,
            components: refinement.components.into_iter().map(|c| (c.name, c.sigma)).collect(),
        },
    })
}

fn toml(config: &Config) -> Result<String, String> {
    config.to_toml().map_err(message)
}

/// The pictures of `views/`, by their names.
fn pictures(capture: &Capture, report: &CaptureReport) -> Vec<(String, Array3<u8>)> {
    let thumbnails = capture.photographs.iter().enumerate();
    let mut pictures: Vec<_> = thumbnails
        .map(|(index, photograph)| (format!("views/{index:02}.png"), thumbnail(photograph.image.view())))
        .collect();
    if let Some(novel) = &report.novel {
        pictures.push(("views/novel.png".to_owned(), bytes(novel.image.view())));
        pictures.push(("views/rendered.png".to_owned(), bytes(novel.rendered.view())));
    }
    pictures
}

/// `origin` (0 none, 1 prior, 2 consensus, 3 field), `seen` and `confirmed` (numbers of photographs).
fn evidence(report: &CaptureReport) -> Option<[Array2<f32>; 3]> {
    let evidence = report.evidence.as_ref()?;
    let origin = evidence.origin.mapv(|origin| match origin {
        DepthOrigin::Missing => 0.0,
        DepthOrigin::Prior => 1.0,
        DepthOrigin::Consensus => 2.0,
        DepthOrigin::Field => 3.0,
    });
    Some([origin, evidence.seen.mapv(f32::from), evidence.confirmed.mapv(f32::from)])
}

impl Outcome {
    fn into_dict(self, py: Python<'_>) -> PyResult<Object<'_>> {
        let parts = PyDict::new(py);
        let Maps { depth, variance, sigma, prior, components } = self.refinement;
        for (name, map) in [("depth", depth), ("variance", variance), ("sigma", sigma), ("prior", prior)] {
            parts.set_item(name, map.into_pyarray(py))?;
        }
        let by_name = PyDict::new(py);
        for (name, sigma) in components {
            by_name.set_item(name, sigma.into_pyarray(py))?;
        }
        parts.set_item("components", by_name)?;
        parts.set_item("image", bytes(self.image.view()).into_pyarray(py))?;
        let PinholeCamera { fx, fy, cx, cy, width, height } = self.camera;
        parts.set_item("camera", (fx, fy, cx, cy, width, height))?;
        parts.set_item("run", self.run)?;
        parts.set_item("config", self.config)?;
        parts.set_item("warnings", self.warnings)?;
        let pictures = PyDict::new(py);
        for (name, picture) in self.pictures {
            pictures.set_item(name, picture.into_pyarray(py))?;
        }
        parts.set_item("pictures", pictures)?;
        let evidence = PyDict::new(py);
        for (name, map) in
            ["origin", "seen", "confirmed"].into_iter().zip(self.evidence.into_iter().flatten())
        {
            evidence.set_item(name, map.into_pyarray(py))?;
        }
        parts.set_item("evidence", evidence)?;
        Ok(parts.into_any())
    }
}
