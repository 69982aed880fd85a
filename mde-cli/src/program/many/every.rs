//! Every photograph of a capture refined: a folder for each, their poses, and one cloud.
//!
//! A folder appears whole, by a rename, with its marker (`finished.json`) in it. A run that finds a marker of the same photographs and
//! settings keeps the folder. The files of all photographs are written at the end.

use crate::output::every::{CLOUD, EveryRecord, PhotographRow, write_all};
use crate::output::export::colmap::{FOLDER as WORKSPACE, LIST};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::names::folders;
use crate::output::record::{About, versions};
use crate::program::args::shard::Shard;
use crate::program::error::{message, partial};
use crate::program::interrupt;
use crate::program::job::Job;
use crate::program::many::item::{finished, mark};
use crate::program::progress::Progress;
use crate::program::provenance::{about, write_json};
use crate::program::report::{INDEX, every_page};
use crate::program::store::folder::{
    ENTRY, NewFolder, OutputFolder, RECORD, check_own, folders_in, read_record, remove_unfinished,
};
use crate::program::store::lock::Lock;
use crate::program::summary::intervals;
use crate::program::terminal::line_of;
use crate::refiner::{Plan, Prepared};
use crate::scene::Scene;
use crate::several::cloud::RefinedView;
use anyhow::{Result, bail};
use mde_eval::table::{Block, Document, Table};
use mde_prior::format::{MILLIMETRES, PngContent, ReadOptions, png_content, read_values};
use ndarray::Array2;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// Files of all photographs and the folder of those for COLMAP, the record last.
const OF_ALL: [&str; 5] = [WORKSPACE, CLOUD, TRANSFORMS, INDEX, RECORD];

/// Checks that the folder is new, or one of an earlier run on a capture; creates nothing.
pub(crate) fn check_folder(output: &Path) -> Result<()> {
    let is_finished = |folder: &Path| folder.join(ENTRY).is_file();
    // A killed run leaves finished photographs, and beside them files of all.
    let any = folders_in(output).iter().any(|folder| is_finished(folder));
    let is_own = |path: &Path| is_finished(path) || any && OF_ALL.iter().any(|file| path.ends_with(file));
    let is_record = |path: &Path| {
        path.ends_with(RECORD) && read_record(path).is_some_and(|record| record["photographs"].is_array())
    };
    check_own(output, is_record, is_own, RECORD)
}

/// What of a capture a run refines.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Some of the photographs, without the files of all.
    pub(crate) shard: Option<Shard>,
    /// What an earlier run finished too.
    pub(crate) force: bool,
}

/// Refines the photographs of the job's capture. Those that a run of the same photographs and settings finished stay as they are.
pub(crate) fn run(
    job: &Job<'_>,
    scene: &Scene,
    plan: &Plan,
    input: &str,
    output: &Path,
    Part { shard, force }: Part,
    progress: &mut Progress,
) -> Result<()> {
    // Removed again where nothing comes into it.
    let _made = NewFolder::make(output)?;
    let _lock = match shard {
        None => {
            let lock = Lock::take(output)?;
            remove_unfinished(output);
            lock
        }
        Some(_) => None,
    };
    let settings = job.refiner.settings();
    let made_from = format!("{:?} {} {}", versions(), job.refiner.identity()?, scene.identity());
    // What is made of all photographs changes none of them.
    let of_each: Vec<_> = job.export.iter().filter(|format| !format.is_of_capture()).collect();
    let made_from = format!("{made_from} {of_each:?}");
    let mut prepared = job.refiner.prepare(scene, plan, progress)?;
    let prior_seconds = prepared.prior_seconds();
    let photographs = scene.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &OF_ALL);
    let (mut rows, mut placed) = (Vec::<PhotographRow>::new(), Vec::new());
    for (index, photograph) in scene.photographs.iter().enumerate() {
        if shard.is_some_and(|shard| !shard.has(&folders[index])) {
            continue;
        }
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
                OF_ALL.iter().chain([&LIST]).for_each(|name| drop(fs::remove_file(output.join(name))));
                progress.next(&counted);
                one(job, &mut prepared, index, &photograph.name, &place, &made_from, progress)?
            }
        };
        if let Some((camera, pose)) = prepared.several().and_then(|several| row.placed(several, index)) {
            placed.push((index, camera, pose));
        }
        rows.push(row);
    }
    if let Some(first) = rows.iter().find_map(PhotographRow::failure)
        && rows.iter().all(|row| row.folder.is_none())
    {
        bail!("no photograph could be refined: {first}");
    }
    if shard.is_some() {
        let text = format!(
            "{} photographs; the same command without --shard writes the cloud and the index",
            rows.len()
        );
        progress.result(
            &text,
            json!({ "event": "done", "output": output.display().to_string(), "photographs": rows }),
        );
        return partial(
            rows.iter().filter(|row| row.folder.is_none()).count(),
            rows.iter().find_map(PhotographRow::failure),
            output,
        );
    }
    let unreadable = scene.unreadable.iter().map(|(name, error)| PhotographRow::failed(name, error));
    rows.extend(unreadable);
    let maps = placed.iter().map(|(index, ..)| Maps::read(&output.join(&folders[*index])));
    let maps = maps.collect::<Result<Vec<_>>>()?;
    let views = placed.iter().zip(&maps).map(|(&(index, camera, pose), maps)| RefinedView {
        folder: &folders[index],
        image: scene.photographs[index].image.view(),
        camera,
        pose,
        depth: maps.depth.view(),
        sigma: maps.sigma.view(),
        png_scale: maps.png_scale,
    });
    let points = write_all(output, &views.collect::<Vec<_>>(), prepared.unit(), job.export)?;
    mde_prior::write_atomic(&output.join(INDEX), every_page(&rows).as_bytes())?;
    let about = About {
        warnings: progress.all_warnings(),
        total_seconds: progress.seconds(),
        ..about("dense", input.to_owned(), prepared.camera(), Some(settings), progress)
    };
    let Some(several) = prepared.several() else {
        bail!("{input}: one photograph; give two or more of one place")
    };
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
    let failed = rows.iter().filter(|row| row.folder.is_none()).count();
    partial(failed, rows.iter().find_map(PhotographRow::failure), output)
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
    let refined = OutputFolder::new(place, true).and_then(|folder| {
        job.produce(prepared, index, name, &folder, progress, |path, refined, _| {
            row.measure(refined);
            row.folder = place.file_name().map(|folder| folder.to_string_lossy().into_owned());
            row.seconds = start.elapsed().as_secs_f64();
            mark(path, made_from, &row)
        })
    });
    match refined {
        Ok(_) => Ok(row),
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
