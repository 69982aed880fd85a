//! The refinement: one photograph, or several of one scene.

mod inputs;
mod one_scale;
mod outcome;
mod save;

use crate::error::{keywords, message, raise};
use crate::prior::Prior;
use crate::settings::Settings;
use crate::worker::{self, Link, Request};
use inputs::Inputs;
pub(crate) use inputs::{Arguments, Camera, is_capture, rigid};
use mde_cli::error::{Error, Result};
use mde_cli::mde_nerf::FieldEvent;
use mde_cli::mde_warp::{Pose, matrix_rows};
use mde_cli::output::every::{EveryRecord, PhotographRow};
use mde_cli::output::names::folders;
use mde_cli::output::record::{TrainingCurve, follow};
use mde_cli::refinement::event::Event;
use mde_cli::refiner::{Observer, Prepared, Refiner};
use mde_cli::scene::Scene;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
pub(crate) use one_scale::OneScale;
use outcome::{Outcome, about};
use pyo3::prelude::*;
use pyo3::types::PyDict;
pub(crate) use save::{list_files, replace_folder, save_all, save_result};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// Names that no folder of a photograph gets.
const RESERVED: [&str; 5] = ["colmap", "cloud.ply", "transforms.json", "run.json", "index.html"];

/// Any Python object.
pub(crate) type Object<'py> = pyo3::Bound<'py, PyAny>;

/// Results, each with the pose of a photograph that others refined, and the record of every photograph.
type Made = (Vec<(Outcome, Option<Pose>)>, Option<String>);

/// Refines the depth of the first photograph, or of `every` one: a dictionary of `results`, `poses` and the record `run` of all.
#[pyfunction]
pub(crate) fn refine<'py>(
    py: Python<'py>,
    prior: &Prior,
    settings: &Settings,
    arguments: Arguments<'py>,
    every: bool,
    model: Option<Object<'py>>,
    progress: Option<Object<'py>>,
) -> PyResult<Object<'py>> {
    let threads = arguments.threads;
    let inputs = Inputs::new(arguments)?;
    let observed = progress.is_some();
    let (outcomes, record) = worker::run(py, threads, server(py, model, progress), |link| {
        let watch = Watched::new(link, observed);
        prior
            .open(link, |open| run(&Refiner::new(open, settings.0.clone())?, inputs, every, watch))
            .map_err(message)
    })?;
    let (mut results, mut poses) = (Vec::new(), Vec::new());
    for (outcome, pose) in outcomes {
        results.push(outcome.into_dict(py)?);
        poses.push(pose.map(|pose| (parts_of(&pose), matrix_rows(&pose))));
    }
    let parts = PyDict::new(py);
    parts.set_item("results", results)?;
    parts.set_item("poses", poses)?;
    parts.set_item("run", record)?;
    Ok(parts.into_any())
}

/// A quaternion w, x, y, z, then a translation. A matrix would lose bits.
fn parts_of(pose: &Pose) -> [f64; 7] {
    let (q, t) = (pose.rotation, pose.translation);
    [q.w, q.i, q.j, q.k, t.x, t.y, t.z]
}

fn run(refiner: &Refiner<'_>, inputs: Inputs, every: bool, mut watch: Watched<'_>) -> Result<Made> {
    let start = Instant::now();
    let input = inputs.input.clone();
    let (mut scene, plan) = inputs.scene(refiner, &mut watch)?;
    scene.every = every;
    let mut prepared = refiner.prepare(&scene, &plan, &mut watch)?;
    if every {
        return run_every(refiner, &scene, &mut prepared, &input, watch, start);
    }
    let refined = prepared.once().refine(0, None, &mut watch)?;
    let outcome = Outcome::new(refiner, refined, input, &watch, start)?;
    Ok((vec![(outcome, None)], None))
}

fn run_every(
    refiner: &Refiner<'_>,
    scene: &Scene,
    prepared: &mut Prepared<'_>,
    input: &str,
    mut watch: Watched<'_>,
    start: Instant,
) -> Result<Made> {
    let prior_seconds = prepared.prior_seconds();
    let names = scene.photographs.iter().map(|photograph| &*photograph.name);
    let folders = folders(names.clone().map(Path::new), &RESERVED);
    let (mut outcomes, mut rows) = (Vec::new(), Vec::new());
    for (index, (name, folder)) in names.zip(&folders).enumerate() {
        // Its record has what it warns of itself, and its own seconds.
        let (mut own, begin) = (Watched::new(watch.link, watch.observed), Instant::now());
        let mut row = match prepared.refine(index, None, &mut own) {
            Ok(refined) => {
                let mut row = PhotographRow { folder: Some(folder.clone()), ..PhotographRow::new(name) };
                row.measure(&refined);
                let outcome = Outcome::new(refiner, refined, name.to_owned(), &own, begin)?;
                let placed = prepared.several().and_then(|several| row.placed(several, index));
                outcomes.push((outcome, placed.map(|(_, pose)| pose)));
                row
            }
            Err(error) if watch.link.is_cancelled() => return Err(error),
            Err(error) => {
                let error = message(error);
                own.warn(format!("{name} is left out: {error}"));
                PhotographRow::failed(name, &error)
            }
        };
        row.seconds = begin.elapsed().as_secs_f64();
        rows.push(row);
        own.warnings.into_iter().for_each(|warning| watch.warn(warning));
        if watch.observed {
            watch.link.send(Request::Progress("photograph", index + 1, folders.len()));
        }
    }
    if let (true, Some(first)) = (outcomes.is_empty(), rows.iter().find_map(PhotographRow::failure)) {
        return Err(Error::Argument(format!("no photograph could be refined: {first}")));
    }
    rows.extend(scene.unreadable.iter().map(|(name, error)| PhotographRow::failed(name, error)));
    let Some(several) = prepared.several() else {
        return Err(Error::Argument(format!("{input}: one photograph; give two or more of one place")));
    };
    let camera = prepared.camera();
    let record = EveryRecord {
        about: about("dense", refiner, input.to_owned(), &camera, &watch, start),
        unit: prepared.unit(),
        photographs: &rows,
        poses: several.report(),
        points: 0,
        prior_seconds,
    };
    Ok((outcomes, Some(outcome::json(&record)?)))
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

/// What is seen of a run.
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

impl Observer for Watched<'_> {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        let seen = match event {
            Event::Begin { stage, iteration, .. } => {
                self.iteration = *iteration;
                Some((stage.name(), 0, 0))
            }
            Event::Part { stage, done, total } => Some((stage.name(), *done, *total)),
            Event::Field { event, view, views } => {
                follow(&mut self.training, self.iteration, event);
                match *event {
                    FieldEvent::Fit { step, steps, .. } => Some(("fit", step, steps)),
                    FieldEvent::Render { row, rows } => Some(("render", view * rows + row, views * rows)),
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
        let warning = keywords(&warning);
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }
}
