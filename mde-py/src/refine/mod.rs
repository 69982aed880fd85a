//! The refinement: one photograph, or several of one scene.

mod every;
mod inputs;
mod one_scale;
mod outcome;

use crate::error::{message, raise};
use crate::prior::Prior;
use crate::settings::{ErrorBar, Settings};
use crate::worker::{self, Link, Request};
pub(crate) use every::{refine_all, save_all};
pub(crate) use inputs::{Arguments, given};
use inputs::{Inputs, capture};
use mde_cli::mde_warp::Pose;
use mde_cli::nalgebra::{Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use mde_cli::naming::Naming;
use mde_cli::output::record::{TrainingCurve, follow};
use mde_cli::prior::bound::BoundPrior;
use mde_cli::refinement::event::Event;
use mde_cli::refiner::finish::Finish;
use mde_cli::refiner::run::{Run, Watch};
use mde_cli::scene::photograph::Opened;
use mde_cli::several::Capture;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
pub(crate) use one_scale::OneScale;
use outcome::{Outcome, Recorded};
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
    let refiner = Refiner { prior, settings, error_bar };
    let serve = server(py, model, progress);
    let outcome =
        worker::run(py, threads, serve, |link| refiner.refine(link, &inputs, observed).map_err(message))?;
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

/// The pose of such numbers.
fn pose_of([w, i, j, k, x, y, z]: Motion) -> Pose {
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Pose::from_parts(Translation3::new(x, y, z), rotation)
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
struct Watched<'l> {
    link: &'l Link,
    observed: bool,
    iteration: usize,
    training: Vec<TrainingCurve>,
    warnings: Vec<String>,
}

impl<'l> Watched<'l> {
    fn new(link: &'l Link, observed: bool) -> Self {
        Self { link, observed, iteration: 0, training: Vec::new(), warnings: Vec::new() }
    }
}

impl Watch for Watched<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        let seen = match event {
            Event::Begin { stage, iteration, .. } => {
                self.iteration = *iteration;
                Some((stage.name(), 0, 0))
            }
            Event::Predicted { done, total } => Some(("prior", *done, *total)),
            Event::Part { stage, done, total } => Some((stage.name(), *done, *total)),
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

    fn warn(&mut self, warning: String) {
        self.warnings.push(warning);
    }
}

/// What a refiner keeps between runs.
struct Refiner<'r> {
    prior: &'r Prior,
    settings: &'r Settings,
    error_bar: &'r ErrorBar,
}

impl Refiner<'_> {
    fn run<'r>(
        &'r self,
        opened: &'r Opened,
        prior: &'r BoundPrior<'r>,
        capture: Option<&'r Capture>,
        inputs: &'r Inputs,
        at_once: usize,
    ) -> Run<'r> {
        let finish = Finish {
            config: &self.settings.config,
            origin: prior.origin(),
            error_bar: &self.error_bar.0,
            known: inputs.scale.as_ref(),
            same_scale: inputs.same_scale,
            unit: inputs.unit,
            naming: Naming::Keywords,
        };
        Run { opened, prior, capture, finish, at_once, keeps_field: inputs.keep_field }
    }

    fn refine(&self, link: &Link, inputs: &Inputs, observed: bool) -> mde_cli::error::Result<Outcome> {
        let start = Instant::now();
        let mut watch = Watched::new(link, observed);
        let linked = self.prior.linked(link);
        let (placed, prior, at_once) = inputs.open(self.settings, &linked, &mut watch)?;
        self.prior.exchanged().into_iter().for_each(|warning| watch.warn(warning.to_owned()));
        let capture = (placed.len() > 1).then(|| capture(&placed)).transpose()?;
        let run = self.run(&placed[0].opened, &prior, capture.as_ref(), inputs, at_once);
        let done = run.refine(&mut watch)?;
        let about = Recorded {
            preset: self.settings.preset,
            input: &inputs.photographs[0].name,
            watch: &watch,
            seconds: start.elapsed().as_secs_f64(),
        };
        Outcome::new(&run, done, &about)
    }
}
