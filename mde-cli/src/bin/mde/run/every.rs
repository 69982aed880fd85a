//! Every photograph of a capture refined: a folder for each, their poses, and one cloud.

use crate::evaluation::results::Partial;
use crate::output::folder::{OutputFolder, RECORD};
use crate::output::provenance::{about, write_json};
use crate::report::{Indexed, index};
use crate::run::interrupt;
use crate::run::job::{Job, Subject};
use crate::run::names::folders;
use crate::run::progress::Progress;
use crate::run::resume::ResumeFolder;
use anyhow::{Context, Result, bail};
use mde_cli::capture::{RefinedView, consistent_points};
use mde_cli::pictures16::MILLIMETRES;
use mde_cli::results::About;
use mde_cli::results::export::transforms::{self, Exposed, FILE as TRANSFORMS};
use mde_cli::results::export::{Exported, ply};
use mde_cli::{Capture, PreparedCapture, SharedNerf, Stages};
use mde_eval::table::{Block, Cell, Column, Document, Table};
use mde_prior::Timed;
use mde_prior::format::{PngContent, ReadOptions, png_content, read_values};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::Vector3;
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::Instant;

const CLOUD: &str = "cloud.ply";
const INDEX: &str = "index.html";
/// The record of a photograph that `--resume` keeps.
const KEPT: &str = "kept.json";

/// One photograph in the summary.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Row {
    photograph: String,
    /// Its folder; none where it failed.
    folder: Option<String>,
    /// Why it failed, or was refined alone.
    reason: Option<String>,
    /// Share of its pixels whose depth another photograph confirms in the sweeps.
    verified: Option<f32>,
    /// Median of sigma over depth.
    sigma: Option<f64>,
    seconds: f64,
    /// Unit of the poses per unit of the results, as bits; none where it was refined alone.
    scale: Option<u64>,
}

/// A photograph refined by the others.
struct Solid {
    photograph: usize,
    folder: String,
    camera: PinholeCamera,
    /// World to camera, in the unit of the depth.
    pose: Pose,
    depth: Array2<f32>,
    sigma: Array2<f32>,
    /// Steps per unit of its depth.png.
    png_scale: f64,
}

/// Finished photographs of an earlier run with the same inputs and settings.
struct Finished {
    folder: ResumeFolder,
    made_from: Value,
}

#[derive(Serialize, Deserialize)]
struct Kept {
    made_from: Value,
    row: Row,
}

/// Refines all photographs of the job's capture; with `made_from` the finished ones are kept beside the output and used again.
pub(crate) fn run(
    job: &Job<'_>,
    folder: &OutputFolder,
    made_from: Option<Value>,
    progress: &mut Progress,
) -> Result<()> {
    let Some(capture) = &job.capture else { bail!("--all: give --views") };
    let finished = made_from.map(|made_from| Finished::new(folder.path(), made_from)).transpose()?;
    let prior = Timed::new(&*job.prior.prior);
    let stages = Stages::new(&prior).with_predictions_at_once(job.at_once);
    let mut prepared =
        PreparedCapture::new(capture, &stages, &job.config, &mut |event| progress.observe(event))?;
    let photographs = capture.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &[CLOUD, TRANSFORMS, RECORD, INDEX]);
    let (mut rows, mut points) = (Vec::new(), 0);
    folder.write(|path| {
        let mut solids = Vec::new();
        for (index, photograph) in capture.photographs.iter().enumerate() {
            let place = path.join(&folders[index]);
            let counted = format!("[{}/{}] {}", index + 1, folders.len(), photograph.name);
            let kept = finished.as_ref().and_then(|finished| finished.take(&folders[index], &place));
            let row = match kept {
                Some(row) => {
                    progress.next(&format!("{counted}: finished before"));
                    row
                }
                None => {
                    progress.next(&counted);
                    let row = one(job, &mut prepared, index, &folders[index], &place, progress)?;
                    if let (Some(finished), true) = (&finished, row.folder.is_some()) {
                        finished.keep(&folders[index], &place, &row)?;
                    }
                    row
                }
            };
            if let (Some(scale), Some(pose), Some(camera)) =
                (row.scale.map(f64::from_bits), prepared.pose(index), prepared.camera(index))
            {
                solids.push(Solid::read(
                    index,
                    &folders[index],
                    &place,
                    camera,
                    in_unit(pose, scale, capture),
                )?);
            }
            rows.push(row);
        }
        if let Some(first) = rows.iter().find_map(failure).filter(|_| rows.iter().all(|r| r.folder.is_none()))
        {
            bail!("no photograph could be refined: {first}");
        }
        let exposed: Vec<Exposed<'_>> = solids.iter().map(Solid::exposed).collect();
        transforms::write(&path.join(TRANSFORMS), &exposed)?;
        points = cloud(&path.join(CLOUD), capture, &solids, job)?;
        let shown: Vec<Indexed<'_>> = rows.iter().map(indexed).collect();
        let page = index(&format!("{} photographs", rows.len()), &shown, &[CLOUD, TRANSFORMS, RECORD]);
        mde_prior::write_atomic(&path.join(INDEX), page.as_bytes())?;
        let about = About {
            preset: Some(job.preset.name()),
            seed: Some(job.config.seed),
            warnings: progress.warnings(),
            total_seconds: progress.seconds(),
            ..about("refine --all", job.input.clone(), &job.camera)
        };
        let record = Record {
            about,
            unit: job.unit(),
            photographs: &rows,
            poses: prepared.report(),
            points,
            prior_seconds: prior.seconds(),
        };
        write_json(&path.join(RECORD), &record)
    })?;
    if let Some(finished) = &finished {
        finished.discard();
    }
    let value = json!({ "event": "done", "output": folder.path().display().to_string(), "photographs": rows, "points": points });
    let text = format!(
        "{points} points in {CLOUD}\nwrote {} in {:.1} s",
        folder.path().display(),
        progress.seconds()
    );
    progress.tables(&Document { blocks: vec![Block::Table(table(&rows))] }, &text, value);
    match rows.iter().find_map(failure) {
        None => Ok(()),
        Some(first) => {
            let failed = rows.iter().filter(|row| row.folder.is_none()).count();
            Err(Partial { failed, first, folder: folder.path().display().to_string() }.into())
        }
    }
}

/// The whole run's `run.json`.
#[derive(Serialize)]
struct Record<'r> {
    #[serde(flatten)]
    about: About<'r>,
    unit: &'static str,
    photographs: &'r [Row],
    poses: &'r mde_cli::CaptureReport,
    /// Points of the cloud.
    points: usize,
    prior_seconds: f64,
}

fn failure(row: &Row) -> Option<String> {
    let reason = row.reason.as_deref().filter(|_| row.folder.is_none())?;
    Some(format!("{}: {reason}", row.photograph))
}

/// Refines one photograph into its folder. Only an interruption is an error; what else fails is in the row.
fn one(
    job: &Job<'_>,
    prepared: &mut PreparedCapture<'_>,
    index: usize,
    folder: &str,
    place: &Path,
    progress: &mut Progress,
) -> Result<Row> {
    let start = Instant::now();
    let name =
        job.capture.as_ref().map(|capture| capture.photographs[index].name.clone()).unwrap_or_default();
    let mut row = Row {
        photograph: name,
        folder: None,
        reason: None,
        verified: None,
        sigma: None,
        seconds: 0.0,
        scale: None,
    };
    let made = refined(job, prepared, index, place, progress, &mut row);
    row.seconds = start.elapsed().as_secs_f64();
    match made {
        Ok(()) => row.folder = Some(folder.to_owned()),
        Err(error) if interrupt::requested() => return Err(error),
        Err(error) => {
            let _ = fs::remove_dir_all(place);
            row.reason = Some(crate::message(&error));
        }
    }
    Ok(row)
}

fn refined(
    job: &Job<'_>,
    prepared: &mut PreparedCapture<'_>,
    index: usize,
    place: &Path,
    progress: &mut Progress,
    row: &mut Row,
) -> Result<()> {
    let Some(photograph) = job.capture.as_ref().and_then(|capture| capture.photographs.get(index)) else {
        bail!("--all: give --views");
    };
    let mut kept = None;
    let prior = Timed::new(&*job.prior.prior);
    let stages = Stages::new(&prior)
        .with_predictions_at_once(job.at_once)
        .with_field(|request| Ok(Box::new(kept.insert(SharedNerf::new(request.nerf()?)).clone())));
    let refinement = prepared.refine(index, stages, &mut |event| progress.observe(event))?;
    let mut camera = job.camera.clone();
    camera.camera = photograph.camera;
    let subject = Subject { input: &photograph.name, image: photograph.image.view(), camera };
    let mut done = job.finished(subject, refinement, index, progress)?;
    done.prior_seconds = prior.seconds();
    fs::create_dir(place).with_context(|| format!("{}: can't make this folder", place.display()))?;
    job.write(place, &done, kept.as_ref(), progress)?;
    let report = done.result.refinement.capture.as_ref();
    row.reason = report.and_then(|report| report.fallback.clone());
    row.verified = report.and_then(|report| report.photographs.get(index)?.verified);
    row.sigma = relative_sigma(&done.result.refinement.depth);
    row.scale = report
        .filter(|report| report.fallback.is_none())
        .and_then(|report| report.scale)
        .map(|[scale, _]| if job.unit() == "capture" { 1.0 } else { scale }.to_bits());
    Ok(())
}

pub(crate) fn relative_sigma(depth: &GaussianDepth) -> Option<f64> {
    let sigma = depth.sigma();
    let known = depth.mean();
    let relative = known.iter().zip(&sigma).filter(|(z, s)| **z > 0.0 && s.is_finite());
    median(relative.map(|(z, s)| f64::from(s / z)))
}

/// The pose for depths in the results' unit. The world is that of a capture with poses in its own unit, else the frame of the
/// capture's reference.
fn in_unit(mut pose: Pose, scale: f64, capture: &Capture) -> Pose {
    pose.translation.vector /= scale;
    match capture.photographs.get(capture.reference).and_then(|reference| reference.pose) {
        Some(world) if scale.to_bits() == 1.0_f64.to_bits() => pose * world,
        _ => pose,
    }
}

impl Solid {
    fn read(
        photograph: usize,
        folder: &str,
        place: &Path,
        camera: PinholeCamera,
        pose: Pose,
    ) -> Result<Self> {
        let map = |name: &str| read_values(place.join(name), &ReadOptions::default());
        let (depth, sigma) = (map("depth.npy")?, map("sigma.npy")?);
        let png_scale = match png_content(place.join("depth.png"))? {
            Some(PngContent::Depth { scale, .. }) => scale,
            _ => MILLIMETRES,
        };
        Ok(Self { photograph, folder: folder.to_owned(), camera, pose, depth, sigma, png_scale })
    }

    fn exposed(&self) -> Exposed<'_> {
        Exposed { folder: &self.folder, camera: self.camera, pose: self.pose, png_scale: self.png_scale }
    }
}

/// Writes the points that two photographs confirm; their number.
fn cloud(path: &Path, capture: &Capture, solids: &[Solid], job: &Job<'_>) -> Result<usize> {
    let unit = job.unit();
    let views: Vec<RefinedView<'_>> = solids
        .iter()
        .map(|s| RefinedView { camera: s.camera, pose: s.pose, depth: s.depth.view(), sigma: s.sigma.view() })
        .collect();
    let depths = solids
        .iter()
        .map(|s| GaussianDepth::new(s.depth.clone(), s.sigma.mapv(|sigma| sigma * sigma)))
        .collect::<mde_uncertainty::Result<Vec<_>>>()?;
    let mut cloud = ply::Cloud::new(job.y_up);
    for point in consistent_points(&views) {
        let solid = &solids[point.view];
        let scene = Exported {
            unit,
            image: capture.photographs[solid.photograph].image.view(),
            camera: &solid.camera,
            depth: &depths[point.view],
            prior: solid.depth.view(),
            components: Vec::new(),
            confidence: None,
            y_up: job.y_up,
            png_scale: solid.png_scale,
        };
        let [row, column] = point.pixel;
        let normal =
            scene.point(row, column).map_or_else(Vector3::zeros, |p| ply::normal(&scene, row, column, p));
        let normal = solid.pose.rotation.inverse() * normal;
        cloud.push(point.position, normal, scene.colour(row, column), point.sigma);
    }
    let count = cloud.len();
    let frame = "world of transforms.json, the frame of its first camera";
    let frame = if count == 0 { "no point is confirmed by two photographs" } else { frame };
    mde_prior::write_atomic(path, &cloud.encode(frame, unit))?;
    Ok(count)
}

/// What the page has of a photograph.
fn indexed(row: &Row) -> Indexed<'_> {
    let measured = || {
        let verified = percent(row.verified.map(f64::from));
        format!("verified {verified} %, median of sigma / depth {} %", percent(row.sigma))
    };
    let text = outcome(row).unwrap_or_else(measured);
    Indexed { photograph: &row.photograph, folder: row.folder.as_deref(), text }
}

/// What became of a photograph that the others did not refine.
fn outcome(row: &Row) -> Option<String> {
    match (&row.folder, &row.reason) {
        (None, reason) => Some(format!("failed: {}", reason.as_deref().unwrap_or("no reason"))),
        (Some(_), Some(reason)) => Some(format!("refined alone: {reason}")),
        (Some(_), None) => None,
    }
}

pub(crate) fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn table(rows: &[Row]) -> Table {
    let columns = vec![
        Column::text("photograph"),
        Column::text("result"),
        Column::number("verified, %"),
        Column::number("sigma / depth, %"),
        Column::number("seconds"),
    ];
    let rows = rows.iter().map(|row| {
        let result = outcome(row).unwrap_or_else(|| row.folder.clone().unwrap_or_default());
        vec![
            Cell::new(row.photograph.clone()),
            Cell::new(result),
            Cell::new(percent(row.verified.map(f64::from))),
            Cell::new(percent(row.sigma)),
            Cell::new(format!("{:.1}", row.seconds)),
        ]
    });
    Table { columns, rows: rows.collect() }
}

impl Finished {
    fn new(output: &Path, made_from: Value) -> Result<Self> {
        Ok(Self { folder: ResumeFolder::beside(output, KEPT)?, made_from })
    }

    /// Copies a finished folder to `place`; nothing where there is none of the same inputs and settings.
    fn take(&self, name: &str, place: &Path) -> Option<Row> {
        let entry = self.folder.entry(name);
        let kept: Kept = serde_json::from_str(&fs::read_to_string(entry.join(KEPT)).ok()?).ok()?;
        if kept.made_from != self.made_from {
            return None;
        }
        let copied = copy(&entry.join("results"), place);
        if copied.is_err() {
            let _ = fs::remove_dir_all(place);
        }
        copied.ok().map(|()| kept.row)
    }

    /// Copies a finished folder beside the output.
    fn keep(&self, name: &str, place: &Path, row: &Row) -> Result<()> {
        let kept = Kept { made_from: self.made_from.clone(), row: row.clone() };
        self.folder.keep(name, |path| {
            copy(place, &path.join("results")).with_context(|| path.display().to_string())?;
            write_json(&path.join(KEPT), &kept)
        })
    }

    /// Removes the folder once the results are written.
    fn discard(&self) {
        self.folder.discard();
    }
}

/// A folder with all that is in it.
pub(crate) fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finished_photograph_is_taken_by_the_same_run_alone() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a");
        fs::create_dir_all(place.join("views")).unwrap();
        fs::write(place.join("views/0.png"), "picture").unwrap();
        let row = Row {
            photograph: "a.png".to_owned(),
            folder: Some("a".to_owned()),
            reason: None,
            verified: Some(0.5),
            sigma: None,
            seconds: 1.0,
            scale: Some(0.3_f64.to_bits()),
        };
        let output = folder.path().join("out");
        let run = Finished::new(&output, json!({ "seed": 0 })).unwrap();
        run.keep("a", &place, &row).unwrap();
        let copied = folder.path().join("b");
        let other = Finished::new(&output, json!({ "seed": 1 })).unwrap();
        assert!(other.take("a", &copied).is_none() && !copied.exists());
        let found = run.take("a", &copied).unwrap();
        assert_eq!((found.scale, found.photograph), (row.scale, row.photograph));
        assert_eq!(fs::read_to_string(copied.join("views/0.png")).unwrap(), "picture");
        run.discard();
        assert!(!output.with_file_name("out.resume").exists());
    }
}
