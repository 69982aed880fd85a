//! The refinement: one photograph, or several of one scene.

mod inputs;
mod one_scale;
mod outcome;

use crate::error::{message, raise};
use crate::prior::Prior;
use crate::settings::{ErrorBar, Settings};
use crate::worker::{self, Link, Request};
pub(crate) use inputs::{Arguments, given};
use inputs::{Inputs, Opened, capture};
use mde_cli::inputs::KnownCamera;
use mde_cli::mde_prior::Timed;
use mde_cli::mde_warp::Pose;
use mde_cli::nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use mde_cli::results::{Finish, TrainingCurve, follow};
use mde_cli::{Event, Naming, SharedNerf, Stages, refine as refine_one, refine_capture};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
pub(crate) use one_scale::OneScale;
use outcome::{Done, Outcome};
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::time::Instant;

/// A rotation as quaternion w, x, y, z, then a translation: a matrix would lose bits.
pub(crate) type Motion = [f64; 7];

/// Any Python object.
type Object<'py> = pyo3::Bound<'py, PyAny>;

/// Refines the depth of the first photograph. The result is a dictionary of its parts.
#[pyfunction]
#[pyo3(signature = (prior, settings, error_bar, arguments, model, progress))]
pub(crate) fn refine<'py>(
    py: Python<'py>,
    prior: &Prior,
    settings: &Settings,
    error_bar: &ErrorBar,
    arguments: Arguments<'py>,
    model: Option<Object<'py>>,
    progress: Option<Object<'py>>,
) -> PyResult<Object<'py>> {
    let threads = arguments.threads;
    let inputs = Inputs::new(arguments)?;
    let observed = progress.is_some();
    let run = Run { prior, settings, error_bar };
    let serve = server(py, model, progress);
    let outcome = worker::run(py, threads, serve, |link| run.work(link, &inputs, observed))?;
    outcome.into_dict(py)
}

/// Runs the callables of a run.
fn server<'py>(
    py: Python<'py>,
    model: Option<Object<'py>>,
    progress: Option<Object<'py>>,
) -> impl FnMut(Request) -> PyResult<()> {
    move |request| match request {
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

impl<'l> Watch<'l> {
    fn new(link: &'l Link, observed: bool) -> Self {
        Self { link, observed, iteration: 0, training: Vec::new(), warnings: Vec::new() }
    }

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

/// The photographs at the size at which they are refined, and the camera of the first: a network's own in place of an assumed one.
fn framed(
    inputs: &Inputs,
    settings: &Settings,
    prior: &Prior,
    watch: &mut Watch<'_>,
) -> Result<(Vec<Opened>, KnownCamera), String> {
    let mut opened = inputs.open(settings, watch)?;
    let mut known = opened[0].known.resized(opened[0].size).map_err(message)?;
    if opened.len() == 1
        && let Some(own) = prior.camera(opened[0].image.view(), &known).map_err(message)?
    {
        known = own;
        opened[0].known = known.resized(opened[0].original).map_err(message)?;
    }
    Ok((opened, known))
}

/// What a refiner keeps between runs.
struct Run<'r> {
    prior: &'r Prior,
    settings: &'r Settings,
    error_bar: &'r ErrorBar,
}

impl Run<'_> {
    fn work(&self, link: &Link, inputs: &Inputs, observed: bool) -> Result<Outcome, String> {
        let Self { prior, settings, error_bar } = *self;
        let config = &settings.config;
        let start = Instant::now();
        let mut watch = Watch::new(link, observed);
        let (opened, mut known) = framed(inputs, settings, prior, &mut watch)?;
        let several = opened.len() > 1;
        let first = &opened[0];
        let origin = prior.origin.at_focal(known.focal());
        let (bound, warnings) =
            prior.bind(link, first.original, first.size, known.focal()).map_err(message)?;
        watch.warnings.extend(warnings);
        let timed = Timed::new(&bound);
        let mut kept = None;
        let mut stages = Stages::new(&timed);
        let at_once = match several {
            true => inputs.predictions_at_once_of(&opened, &timed),
            false => inputs.predictions_at_once(first, config, &timed),
        };
        stages = stages.with_predictions_at_once(at_once?);
        if let Some(budget) = settings.budget {
            stages = stages.with_budget(budget);
        }
        if !several {
            watch.warnings.extend(known.warning(Naming::Keywords));
        }
        if inputs.keep_field {
            let mut keep = |field| Box::new(kept.insert(SharedNerf::new(field)).clone());
            stages = stages.with_field(move |request| Ok(keep(request.nerf()?)));
        }
        let capture = several.then(|| capture(&opened)).transpose()?;
        let mut observe = |event: &Event| watch.observe(event);
        let refined = match &capture {
            Some(capture) => refine_capture(capture, stages, config, &mut observe),
            None => refine_one(first.image.view(), &known.camera, stages, config, &mut observe),
        };
        let mut refinement = refined.map_err(message)?;
        let field = kept.map(|field: SharedNerf| field.lock().to_bytes()).transpose().map_err(message)?;
        if inputs.keep_field && field.is_none() {
            watch.warnings.push(
                "keep_field: no field was fitted, so none is kept; set refinement.field = \"always\" to fit one".to_owned(),
            );
        }
        let alone = inputs.same_scale.and_then(|found| found.warning(Naming::Keywords));
        watch.warnings.extend(alone);
        let mut image = first.image.view();
        if let Some(full) = &first.full {
            refinement = refinement.upsampled(image, full.view()).map_err(message)?;
            let (height, width, _) = full.dim();
            (image, known) = (full.view(), first.known.resized((height, width)).map_err(message)?);
        }
        let finish = Finish {
            config,
            origin: &origin,
            error_bar: &error_bar.0,
            known: inputs.scale.as_ref(),
            same_scale: inputs.same_scale,
            unit: inputs.unit,
            naming: Naming::Keywords,
        };
        let mut warn = |warning| watch.warnings.push(warning);
        let result = finish.apply(refinement, 0, &mut known, &mut warn).map_err(message)?;
        let seconds = (start.elapsed().as_secs_f64(), timed.seconds());
        let input = &inputs.photographs[0].name;
        Done { origin, settings, watch, result, known, capture, field, input, image, seconds }.outcome()
    }
}
