//! Every photograph of a capture refined: a folder for each, their poses, and one cloud.
//!
//! A folder appears whole, by a rename, with its marker (`finished.json`) in it. A run that finds a marker of the same photographs and
//! settings keeps the folder. The files of all photographs are written at the end.

use crate::output::every::{CLOUD, EveryRecord, PhotographRow, write_all};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::names::folders;
use crate::output::record::{About, versions};
use crate::program::error::Partial;
use crate::program::error::message;
use crate::program::interrupt;
use crate::program::job::Job;
use crate::program::many::item::finished;
use crate::program::progress::Progress;
use crate::program::provenance::{about, write_json};
use crate::program::report::{INDEX, every_page};
use crate::program::store::entry::Entry;
use crate::program::store::folder::{
    ENTRY, NewFolder, OutputFolder, RECORD, check_place, list_files, remove_unfinished,
};
use crate::program::store::lock::Lock;
use crate::program::summary::intervals;
use crate::program::terminal::line_of;
use crate::refiner::depth_png::MILLIMETRES;
use crate::refiner::{Plan, Prepared};
use crate::scene::Scene;
use crate::several::cloud::RefinedView;
use anyhow::{Context, Result, bail, ensure};
use mde_eval::table::{Block, Document, Table};
use mde_prior::format::{PngContent, ReadOptions, png_content, read_values};
use mde_prior::{FileKind, open};
use mde_warp::{PinholeCamera, Pose};
use ndarray::Array2;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::time::Instant;

/// Files of all photographs, the record last.
const OF_ALL: [&str; 4] = [CLOUD, TRANSFORMS, INDEX, RECORD];

/// A photograph refined by the others, whose maps are in its folder.
struct Placed {
    photograph: usize,
    camera: PinholeCamera,
    pose: Pose,
}

/// Checks that the folder is new, or one of an earlier run on a capture; creates nothing.
pub(crate) fn check_folder(output: &Path) -> Result<()> {
    check_place("-o", output)?;
    let shown = output.display();
    if !output.exists() || is_record(&output.join(RECORD)) {
        return Ok(());
    }
    // A killed run leaves finished photographs, files of all, and what is swept.
    let (mut finished, mut others) = (false, false);
    for entry in fs::read_dir(output).with_context(|| shown.to_string())? {
        let name = entry.with_context(|| shown.to_string())?.file_name();
        match output.join(&name).join(ENTRY).is_file() {
            true => finished = true,
            false if name.as_encoded_bytes().starts_with(b".mde-") => {}
            false => others |= !OF_ALL.iter().any(|file| name == *file),
        }
    }
    ensure!(
        !others && (finished || !OF_ALL.iter().any(|name| output.join(name).exists())),
        "{shown}: holds no {RECORD} of an earlier run with --all; give another name to -o"
    );
    Ok(())
}

/// Whether it is the record of a run on a capture.
fn is_record(path: &Path) -> bool {
    let record = open::read(path, FileKind::Settings)
        .ok()
        .and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    record.is_some_and(|record| record["photographs"].is_array())
}

/// Refines all photographs of the job's capture. Those that a run of the same `made_from` finished stay as they are, unless `force` is set.
pub(crate) fn run(
    job: &Job<'_>,
    scene: &Scene,
    plan: &Plan,
    input: &str,
    output: &Path,
    force: bool,
    progress: &mut Progress,
) -> Result<()> {
    // Removed again where nothing comes into it.
    let _made = NewFolder::make(output)?;
    let _lock = Lock::take(output)?;
    remove_unfinished(output);
    let settings = job.refiner.settings();
    let made_from = format!("{:?} {} {}", versions(), job.refiner.identity()?, scene.identity());
    let made_from = format!("{made_from} {:?}", job.export);
    let mut prepared = job.refiner.prepare(scene, plan, progress)?;
    let prior_seconds = prepared.prior_seconds();
    let photographs = scene.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &OF_ALL);
    let (mut rows, mut placed) = (Vec::<PhotographRow>::new(), Vec::new());
    for (index, photograph) in scene.photographs.iter().enumerate() {
        let place = output.join(&folders[index]);
        let counted = format!("[{}/{}] {}", index + 1, folders.len(), photograph.name);
        let kept = finished(&place).filter(|kept| {
            !force && kept.made_from == made_from && kept.row.folder.as_deref() == Some(&*folders[index])
        });
        let row = match kept {
            Some(kept) => {
                progress.next(&format!("{counted}: finished before"));
                kept.row
            }
            None => {
                // Those of an earlier run are of other maps than the photograph will have.
                OF_ALL.iter().for_each(|name| drop(fs::remove_file(output.join(name))));
                progress.next(&counted);
                one(job, &mut prepared, index, &photograph.name, &place, &made_from, progress)?
            }
        };
        if let Some((camera, pose)) = prepared.several().and_then(|several| row.placed(several, index)) {
            placed.push(Placed { photograph: index, camera, pose });
        }
        rows.push(row);
    }
    if let Some(first) = rows.iter().find_map(PhotographRow::failure)
        && rows.iter().all(|row| row.folder.is_none())
    {
        bail!("no photograph could be refined: {first}");
    }
    let maps = placed.iter().map(|placed| Maps::read(&output.join(&folders[placed.photograph])));
    let maps = maps.collect::<Result<Vec<_>>>()?;
    let views = placed.iter().zip(&maps).map(|(placed, maps)| RefinedView {
        folder: &folders[placed.photograph],
        image: scene.photographs[placed.photograph].image.view(),
        camera: placed.camera,
        pose: placed.pose,
        depth: maps.depth.view(),
        sigma: maps.sigma.view(),
        png_scale: maps.png_scale,
    });
    let points = write_all(output, &views.collect::<Vec<_>>(), prepared.unit())?;
    mde_prior::write_atomic(&output.join(INDEX), every_page(&rows).as_bytes())?;
    let about = About {
        preset: Some(settings.preset.name()),
        seed: Some(settings.config.seed),
        warnings: progress.all_warnings(),
        total_seconds: progress.seconds(),
        ..about("refine --all", input.to_owned(), prepared.camera())
    };
    let Some(several) = prepared.several() else { bail!("--all: give --views") };
    let record = EveryRecord {
        about,
        unit: prepared.unit(),
        photographs: &rows,
        poses: several.report(),
        points,
        prior_seconds,
    };
    write_json(&output.join(RECORD), &record)?;
    let value = json!({ "event": "done", "output": output.display().to_string(), "photographs": rows, "points": points });
    let text = format!(
        "{points} points in {CLOUD}\n{}wrote {} in {:.1} s",
        intervals(&settings.error_bar),
        line_of(output),
        progress.seconds()
    );
    progress.tables(&Document { blocks: vec![Block::Table(table(&rows))] }, &text, value);
    match rows.iter().find_map(PhotographRow::failure) {
        None => Ok(()),
        Some(first) => {
            let failed = rows.iter().filter(|row| row.folder.is_none()).count();
            Err(Partial { failed, first, folder: output.display().to_string() }.into())
        }
    }
}

/// Refines one photograph into its folder. Only an interruption is an error; what else fails is in the row.
fn one(
    job: &Job<'_>,
    prepared: &mut Prepared<'_>,
    index: usize,
    name: &str,
    place: &Path,
    made_from: &str,
    progress: &mut Progress,
) -> Result<PhotographRow> {
    let start = Instant::now();
    let mut row = PhotographRow::new(name);
    let mut refined = || -> Result<()> {
        let folder = OutputFolder::new(place, true)?;
        job.produce(prepared, index, name, &folder, progress, |path, refined, _| {
            row.measure(refined);
            row.folder = place.file_name().map(|folder| folder.to_string_lossy().into_owned());
            row.seconds = start.elapsed().as_secs_f64();
            list_files(path)?;
            Entry::write(path, ENTRY, made_from.into(), row.clone()).map(drop)
        })?;
        Ok(())
    };
    match refined() {
        Ok(()) => Ok(row),
        Err(error) if interrupt::requested() => Err(error),
        Err(error) => Ok(PhotographRow {
            seconds: start.elapsed().as_secs_f64(),
            ..PhotographRow::failed(name, &message(&error))
        }),
    }
}

/// The maps in a photograph's folder, which are not all in memory before.
struct Maps {
    depth: Array2<f32>,
    sigma: Array2<f32>,
    png_scale: f64,
}

impl Maps {
    fn read(folder: &Path) -> Result<Self> {
        let map = |name: &str| read_values(folder.join(name), &ReadOptions::default());
        let png_scale = match png_content(folder.join("depth.png"))? {
            Some(PngContent::Depth { scale, .. }) => scale,
            _ => MILLIMETRES,
        };
        Ok(Self { depth: map("depth.npy")?, sigma: map("sigma.npy")?, png_scale })
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1}", 100.0 * s))
}

fn table(rows: &[PhotographRow]) -> Table {
    let heads = ["photograph", "result", "verified, %", "sigma / depth, %", "seconds"];
    let rows = rows.iter().map(|row| {
        let result = match (row.failed_or_alone(), &row.folder) {
            (None, folder) => folder.clone().unwrap_or_default(),
            (Some(text), _) => text,
        };
        vec![
            row.photograph.clone(),
            result,
            percent(row.verified.map(f64::from)),
            percent(row.sigma),
            format!("{:.1}", row.seconds),
        ]
    });
    Table::new(2, heads, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_continued_and_one_of_others_is_refused() {
        let place = tempfile::tempdir().unwrap();
        let out = place.path().join("out");
        check_folder(&out).unwrap();
        assert!(!out.exists());
        let write = |name: &str, text: &str| {
            let path = out.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        // What runs leave that were killed at their first photograph, before their files of all, and before the last of these.
        for left in [".mde-left", "a/finished.json", CLOUD] {
            write(left, "");
            check_folder(&out).unwrap();
        }
        // The record of one photograph.
        write(RECORD, "{}");
        write("thesis.txt", "years");
        assert!(check_folder(&out).unwrap_err().to_string().contains("another name to -o"));
        write(RECORD, r#"{ "photographs": [] }"#);
        check_folder(&out).unwrap();
        fs::remove_dir_all(&out).unwrap();
        write(CLOUD, "of another program");
        assert!(check_folder(&out).is_err());
    }
}
