//! The refinement: one photograph, or several of one scene.

mod inputs;
mod outcome;

use crate::error::{message, raise};
use crate::prior::Prior;
use crate::settings::{ErrorBar, Settings};
use crate::worker::{self, Link, Request};
pub(crate) use inputs::{Arguments, given};
use inputs::{Inputs, capture};
use mde_cli::mde_prior::Timed;
use mde_cli::mde_warp::Pose;
use mde_cli::nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use mde_cli::results::{Finish, TrainingCurve, follow};
use mde_cli::{Event, Naming, Stages, refine as refine_one, refine_capture};
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
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
    let run = Run { prior, settings, error_bar };
    let outcome = worker::run(py, threads, serve, |link| run.work(link, &inputs, observed))?;
    outcome.into_dict(py)
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
        let mut watch = Watch { link, observed, iteration: 0, training: Vec::new(), warnings: Vec::new() };
        let mut opened = inputs.open(settings, &mut watch)?;
        let several = opened.len() > 1;
        let mut known = opened[0].known.resized(opened[0].size).map_err(message)?;
        if !several && let Some(own) = prior.camera(opened[0].image.view(), &known).map_err(message)? {
            known = own;
            opened[0].known = known.resized(opened[0].original).map_err(message)?;
        }
        let first = &opened[0];
        let origin = prior.origin.at_focal(known.focal());
        let (bound, warnings) =
            prior.bind(link, first.original, first.size, known.focal()).map_err(message)?;
        watch.warnings.extend(warnings);
        let timed = Timed::new(&bound);
        let mut stages = Stages::new(&timed);
        if let Some(budget) = settings.budget {
            stages = stages.with_budget(budget);
        }
        if !several {
            watch.warnings.extend(known.warning(Naming::Keywords));
        }
        let capture = several.then(|| capture(&opened)).transpose()?;
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
        let finish = Finish {
            config,
            origin: &origin,
            error_bar: &error_bar.0,
            known: inputs.scale.as_ref(),
            same_scale: None,
            unit: inputs.unit,
            naming: Naming::Keywords,
        };
        let mut warn = |warning| watch.warnings.push(warning);
        let result = finish.apply(refinement, 0, &mut known, &mut warn).map_err(message)?;
        let seconds = (start.elapsed().as_secs_f64(), timed.seconds());
        let input = &inputs.photographs[0].name;
        Done { origin, settings, watch, result, known, capture, input, image, seconds }.outcome()
    }
}
