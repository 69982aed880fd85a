//! Every photograph of a capture refined.

use super::inputs::{Arguments, Inputs, capture};
use super::outcome::{Outcome, Recorded};
use super::{Motion, Object, Refiner, Watched, motion, pose_of, server};
use crate::error::{message, raise};
use crate::prior::Prior;
use crate::settings::{ErrorBar, Settings};
use crate::worker::{self, Link, Request};
use mde_cli::error::{Error, Result};
use mde_cli::mde_prior::Timed;
use mde_cli::mde_warp::{PinholeCamera, Pose};
use mde_cli::output::every::{EveryRecord, EveryRow, Solid, write_all};
use mde_cli::output::names::folders;
use mde_cli::output::record::About;
use mde_cli::refinement::stages::Stages;
use mde_cli::refiner::depth_png::DepthPng;
use mde_cli::refiner::run::Watch;
use mde_cli::several::prepared::PreparedCapture;
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Names that no folder of a photograph gets.
const RESERVED: [&str; 4] = ["cloud.ply", "transforms.json", "run.json", "index.html"];

/// The photographs, each with its outcome and, where the others refined it, its camera and pose.
struct Every {
    outcomes: Vec<(Outcome, Option<(PinholeCamera, Pose)>)>,
    folders: Vec<String>,
    unit: &'static str,
    run: String,
}

/// Refines the depth of every photograph. The result is a dictionary: `results` as those of `refine`, `poses`, `folders`, `unit`, `run`.
#[pyfunction]
#[pyo3(signature = (prior, settings, error_bar, arguments, model, progress))]
pub(crate) fn refine_all<'py>(
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
    let every =
        worker::run(py, threads, serve, |link| refiner.every(link, &inputs, observed).map_err(message))?;
    let parts = PyDict::new(py);
    let (mut results, mut poses) = (Vec::new(), Vec::new());
    for (outcome, placed) in every.outcomes {
        results.push(outcome.into_dict(py)?);
        poses.push(placed.map(|(_, pose)| {
            let rows = pose.to_homogeneous();
            let rows: [[f64; 4]; 4] = std::array::from_fn(|row| std::array::from_fn(|c| rows[(row, c)]));
            (motion(&pose), rows)
        }));
    }
    parts.set_item("results", results)?;
    parts.set_item("poses", poses)?;
    parts.set_item("folders", every.folders)?;
    parts.set_item("unit", every.unit)?;
    parts.set_item("run", every.run)?;
    Ok(parts.into_any())
}

impl Refiner<'_> {
    fn every(&self, link: &Link, inputs: &Inputs, observed: bool) -> Result<Every> {
        let start = Instant::now();
        let mut watch = Watched::new(link, observed);
        let linked = self.prior.linked(link);
        let (placed, prior, at_once) = inputs.open(self.settings, &linked, &mut watch)?;
        self.prior.exchanged().into_iter().for_each(|warning| watch.warn(warning.to_owned()));
        let capture = capture(&placed)?;
        let run = self.run(&placed[0].opened, &prior, None, inputs, at_once);
        let timed = Timed::new(&prior);
        let stages = Stages::new(&timed).with_predictions_at_once(at_once);
        let mut prepared =
            PreparedCapture::new(&capture, &stages, run.finish.config, &mut |event| watch.event(event))?;
        let folders = folders(capture.photographs.iter().map(|one| Path::new(&one.name)), &RESERVED);
        let (mut outcomes, mut rows) = (Vec::new(), Vec::new());
        for (index, folder) in folders.iter().enumerate() {
            let begin = Instant::now();
            let name = &capture.photographs[index].name;
            let mut row = EveryRow::new(name);
            watch.training.clear();
            let named = |error| Error::Argument(format!("{name}: {}", message(error)));
            let done = run.refine_one(&mut prepared, index, &mut watch).map_err(|error| match error {
                Error::Interrupted => Error::Interrupted,
                error => named(error),
            })?;
            row.measure(&done.result, index);
            let recorded = Recorded {
                preset: self.settings.preset,
                input: name,
                watch: &watch,
                seconds: start.elapsed().as_secs_f64(),
            };
            let outcome = Outcome::new(&run, done, &recorded)?;
            (row.folder, row.seconds) = (Some(folder.clone()), begin.elapsed().as_secs_f64());
            outcomes.push((outcome, row.placed(&prepared, index)));
            rows.push(row);
            if observed {
                link.send(Request::Progress("photograph", index + 1, folders.len()));
            }
        }
        let about = About {
            versions: BTreeMap::from([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]),
            preset: Some(self.settings.preset.name()),
            seed: Some(run.finish.config.seed),
            warnings: &watch.warnings,
            total_seconds: start.elapsed().as_secs_f64(),
            ..About::new("refine --all", inputs.photographs[0].name.clone(), &run.opened.camera)
        };
        let record = EveryRecord {
            about,
            unit: run.finish.unit(),
            photographs: &rows,
            poses: prepared.report(),
            points: 0,
            prior_seconds: timed.seconds(),
        };
        let record = serde_json::to_string(&record).map_err(Error::external)?;
        Ok(Every { outcomes, folders, unit: run.finish.unit(), run: record })
    }
}

/// A photograph that the others refined.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Refined<'py> {
    folder: String,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    /// fx, fy, cx, cy, width, height.
    camera: (f64, f64, f64, f64, usize, usize),
    pose: Motion,
    depth: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
}

/// Writes `transforms.json` and `cloud.ply` of all photographs. The result is the number of points.
#[pyfunction]
#[pyo3(signature = (folder, photographs, unit))]
pub(crate) fn save_all(
    py: Python<'_>,
    folder: PathBuf,
    photographs: Vec<Refined<'_>>,
    unit: &str,
) -> PyResult<usize> {
    let unit = crate::files::unit(unit);
    let views = photographs.iter().map(|one| {
        let maps = (one.image.as_array(), one.depth.as_array(), one.sigma.as_array());
        (one.folder.as_str(), one.camera, one.pose, maps)
    });
    let views: Vec<_> = views.collect();
    let write = || -> Result<usize> {
        let solids = views.into_iter().map(|(folder, camera, pose, (image, depth, sigma))| {
            let (fx, fy, cx, cy, width, height) = camera;
            Ok(Solid {
                folder,
                image,
                camera: PinholeCamera::new(fx, fy, cx, cy, width, height)?,
                pose: pose_of(pose),
                png_scale: DepthPng::new(unit, depth.iter().copied()).scale,
                depth: depth.to_owned(),
                sigma: sigma.to_owned(),
            })
        });
        write_all(&folder, &solids.collect::<Result<Vec<_>>>()?, unit)
    };
    py.detach(write).map_err(raise)
}
