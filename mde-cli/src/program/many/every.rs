//! Every photograph of a capture refined: a folder for each, their poses, and one cloud.

use crate::program::evaluation::results::Partial;
use crate::program::store::contents::{Contents, checksums};
use crate::program::store::folder::{OutputFolder, RECORD};
use crate::program::provenance::{about, write_json};
use crate::program::report::{Indexed, index};
use crate::program::summary::intervals;
use crate::program::interrupt;
use crate::program::job::Job;
use crate::program::progress::Progress;
use crate::program::resume::ResumeFolder;
use anyhow::{Context, Result, bail};
use crate::refiner::depth_png::MILLIMETRES;
use crate::output::record::About;
use crate::output::every::{CLOUD, EveryRecord, EveryRow, Solid, write_all};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::names::folders;
use crate::several::Capture;
use crate::several::prepared::PreparedCapture;
use crate::refinement::stages::Stages;
use mde_eval::table::{Block, Cell, Column, Document, Table};
use mde_prior::Timed;
use mde_prior::format::{PngContent, ReadOptions, png_content, read_values};
use mde_warp::{PinholeCamera, Pose};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::Instant;

/// The page of all photographs.
pub(crate) const INDEX: &str = "index.html";
/// The record of a photograph that `--resume` keeps.
const KEPT: &str = "kept.json";

/// A photograph refined by the others, whose maps are in its folder.
struct Placed {
    photograph: usize,
    camera: PinholeCamera,
    pose: Pose,
}

/// Finished photographs of an earlier run with the same inputs and settings.
struct Finished {
    folder: ResumeFolder,
    made_from: Value,
}

#[derive(Serialize, Deserialize)]
struct Kept {
    made_from: Value,
    row: EveryRow,
    /// CRC-32 of the files of the results.
    checksums: Contents<u32>,
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
    let prior = Timed::new(&job.prior);
    let stages = Stages::new(&prior).with_predictions_at_once(job.at_once);
    let mut prepared =
        PreparedCapture::new(capture, &stages, &job.config, &mut |event| progress.observe(event))?;
    let photographs = capture.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &[CLOUD, TRANSFORMS, RECORD, INDEX]);
    let (mut rows, mut points) = (Vec::<EveryRow>::new(), 0);
    folder.write(|path| {
        let mut placed = Vec::new();
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
            if let Some((camera, pose)) = row.placed(&prepared, index) {
                placed.push(Placed { photograph: index, camera, pose });
            }
            rows.push(row);
        }
        if let Some(first) = rows.iter().find_map(EveryRow::failure)
            && rows.iter().all(|row| row.folder.is_none())
        {
            bail!("no photograph could be refined: {first}");
        }
        let solid = |placed: &Placed| placed.read(path, &folders[placed.photograph], capture);
        let solids = placed.iter().map(solid).collect::<Result<Vec<_>>>()?;
        points = write_all(path, &solids, job.unit(), job.y_up)?;
        mde_prior::write_atomic(&path.join(INDEX), every_page(&rows).as_bytes())?;
        let about = About {
            preset: Some(job.preset.name()),
            seed: Some(job.config.seed),
            warnings: progress.warnings(),
            total_seconds: progress.seconds(),
            ..about("refine --all", job.input.clone(), &job.opened.camera)
        };
        let record = EveryRecord {
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
        "{points} points in {CLOUD}\n{}wrote {} in {:.1} s",
        intervals(&job.error_bar),
        folder.path().display(),
        progress.seconds()
    );
    progress.tables(&Document { blocks: vec![Block::Table(table(&rows))] }, &text, value);
    match rows.iter().find_map(EveryRow::failure) {
        None => Ok(()),
        Some(first) => {
            let failed = rows.iter().filter(|row| row.folder.is_none()).count();
            Err(Partial { failed, first, folder: folder.path().display().to_string() }.into())
        }
    }
}

/// Refines one photograph into its folder. Only an interruption is an error; what else fails is in the row.
fn one<'j>(
    job: &'j Job<'_>,
    prepared: &mut PreparedCapture<'j>,
    index: usize,
    folder: &str,
    place: &Path,
    progress: &mut Progress,
) -> Result<EveryRow> {
    let start = Instant::now();
    let name =
        job.capture.as_ref().map(|capture| capture.photographs[index].name.clone()).unwrap_or_default();
    let mut row = EveryRow::new(&name);
    let made = refined(job, prepared, index, place, progress, &mut row);
    row.seconds = start.elapsed().as_secs_f64();
    match made {
        Ok(()) => row.folder = Some(folder.to_owned()),
        Err(error) if interrupt::requested() => return Err(error),
        Err(error) => {
            let _ = fs::remove_dir_all(place);
            row.reason = Some(crate::program::message(&error));
        }
    }
    Ok(row)
}

fn refined<'j>(
    job: &'j Job<'_>,
    prepared: &mut PreparedCapture<'j>,
    index: usize,
    place: &Path,
    progress: &mut Progress,
    row: &mut EveryRow,
) -> Result<()> {
    let done = job.of_capture(None).refine_one(prepared, index, progress)?;
    let scored = job.scored(done, progress)?;
    fs::create_dir(place).with_context(|| format!("{}: can't make this folder", place.display()))?;
    job.write(place, &row.photograph, &scored, progress)?;
    row.measure(&scored.done.result, index);
    Ok(())
}

impl Placed {
    /// With the maps of its folder, which are not all in memory meanwhile.
    fn read<'r>(&self, root: &Path, folder: &'r str, capture: &'r Capture) -> Result<Solid<'r>> {
        let place = root.join(folder);
        let map = |name: &str| read_values(place.join(name), &ReadOptions::default());
        let (depth, sigma) = (map("depth.npy")?, map("sigma.npy")?);
        let png_scale = match png_content(place.join("depth.png"))? {
            Some(PngContent::Depth { scale, .. }) => scale,
            _ => MILLIMETRES,
        };
        let image = capture.photographs[self.photograph].image.view();
        Ok(Solid { folder, image, camera: self.camera, pose: self.pose, depth, sigma, png_scale })
    }
}

/// The page of all photographs.
pub(crate) fn every_page(rows: &[EveryRow]) -> String {
    let shown: Vec<Indexed<'_>> = rows.iter().map(indexed).collect();
    index(&format!("{} photographs", rows.len()), &shown, &[CLOUD, TRANSFORMS, RECORD])
}

/// What the page has of a photograph.
fn indexed(row: &EveryRow) -> Indexed<'_> {
    let measured = || {
        let verified = percent(row.verified.map(f64::from));
        format!("verified {verified} %, median of sigma / depth {} %", percent(row.sigma))
    };
    let text = outcome(row).unwrap_or_else(measured);
    Indexed { photograph: &row.photograph, folder: row.folder.as_deref(), text }
}

/// What became of a photograph that the others did not refine.
fn outcome(row: &EveryRow) -> Option<String> {
    match (&row.folder, &row.reason) {
        (None, reason) => Some(format!("failed: {}", reason.as_deref().unwrap_or("no reason"))),
        (Some(_), Some(reason)) => Some(format!("refined alone: {reason}")),
        (Some(_), None) => None,
    }
}

pub(crate) fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn table(rows: &[EveryRow]) -> Table {
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

    /// Copies a finished folder to `place`; nothing where there is none of the same inputs and settings, or where a file is not as it was
    /// written.
    fn take(&self, name: &str, place: &Path) -> Option<EveryRow> {
        let entry = self.folder.entry(name);
        let kept: Kept = serde_json::from_str(&fs::read_to_string(entry.join(KEPT)).ok()?).ok()?;
        if kept.made_from != self.made_from {
            return None;
        }
        let copied = copy(&entry.join("results"), place).and_then(|()| checksums(place));
        if copied.is_ok_and(|copied| copied == kept.checksums) {
            return Some(kept.row);
        }
        let _ = fs::remove_dir_all(place);
        None
    }

    /// Copies a finished folder beside the output.
    fn keep(&self, name: &str, place: &Path, row: &EveryRow) -> Result<()> {
        self.folder.keep(name, |path| {
            let fault = || path.display().to_string();
            let checksums = checksums(place).with_context(fault)?;
            copy(place, &path.join("results")).with_context(fault)?;
            let kept = Kept { made_from: self.made_from.clone(), row: row.clone(), checksums };
            write_json(&path.join(KEPT), &kept)
        })
    }

    /// Removes the folder once the results are written.
    fn discard(&self) {
        self.folder.discard();
    }
}

/// A folder with all that is in it; `to` may exist.
pub(crate) fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
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
        let row = EveryRow {
            folder: Some("a".to_owned()),
            verified: Some(0.5),
            scale: Some(0.3_f64.to_bits()),
            ..EveryRow::new("a.png")
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
        // One that was altered, cut or removed since.
        let picture = output.with_file_name("out.resume/a/results/views/0.png");
        for altered in [Some("picturE"), Some(""), None] {
            fs::remove_dir_all(&copied).unwrap();
            match altered {
                Some(text) => fs::write(&picture, text).unwrap(),
                None => fs::remove_file(&picture).unwrap(),
            }
            assert!(run.take("a", &copied).is_none() && !copied.exists(), "{altered:?}");
            fs::create_dir(&copied).unwrap();
        }
        run.discard();
        assert!(!output.with_file_name("out.resume").exists());
    }
}
