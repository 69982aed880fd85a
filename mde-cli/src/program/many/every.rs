//! Every photograph of a capture refined. The files of all of them, such as the poses and one cloud, are written at the end.

use crate::output::every::{CLOUD, EveryRecord, MESHES, PhotographRow, write_all};
use crate::output::export::colmap::FOLDER as WORKSPACE;
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::export::{Format, RefinedView};
use crate::output::names::folders;
use crate::output::record::{About, versions};
use crate::program::many::{finish, finished, mark};
use crate::program::report::{INDEX, every_page};
use crate::program::store::{OpenFolder, OutputFolder, RECORD};
use crate::program::{DenseArgs, Job, Progress, about, interrupt, intervals, message, number, write_json};
use crate::refiner::Plan;
use crate::refiner::plan::gathered_bytes;
use crate::scene::{Photograph, Scene};
use anyhow::{Result, bail};
use mde_eval::table::{Block, Document, Table};
use mde_mvs::capture::COLMAP_FUSION;
use mde_mvs::cloud::DepthView;
use mde_prior::format::{MILLIMETRES, PngContent, ReadOptions, png_content, read_values};
use ndarray::Array2;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// Files of all photographs and the folder of those for COLMAP, the record last.
const OF_ALL: [&str; 7] = [WORKSPACE, CLOUD, MESHES[0], MESHES[1], TRANSFORMS, INDEX, RECORD];

/// Checks that the folder is new, or one of an earlier run on a capture; creates nothing.
pub(crate) fn check_folder(output: &Path) -> Result<()> {
    super::check_folder(output, RECORD, &OF_ALL)
}

/// Refines the photographs of the job's capture, or the part that the arguments name.
pub(crate) fn run(
    job: &Job<'_>,
    scene: &Scene,
    plan: &Plan,
    args: &DenseArgs,
    output: &Path,
    progress: &mut Progress,
) -> Result<()> {
    let settings = job.refiner.settings();
    let (size, count) = (scene.photographs.first().map(Photograph::size), scene.photographs.len());
    let gathered = |pixels| gathered_bytes(pixels, count as u64, job.export.contains(&Format::Mesh));
    settings.memory.check(&format!("{count} photographs"), size.unwrap_or_default(), gathered)?;
    let _folder = OpenFolder::open(output, args.shard.is_some())?;
    // What is made of all photographs changes none of them.
    let of_each: Vec<_> = job.export.iter().filter(|format| !format.is_of_capture()).collect();
    let of_all = format!("{:?} {} {} {of_each:?}", versions(), job.refiner.identity()?, scene.identity());
    let mut prepared = job.refiner.prepare(scene, plan, progress)?;
    let prior_seconds = prepared.prior_seconds();
    let photographs = scene.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &OF_ALL);
    let (mut rows, mut placed) = (Vec::<PhotographRow>::new(), Vec::new());
    for (index, (photograph, folder)) in scene.photographs.iter().zip(&folders).enumerate() {
        if args.shard.is_some_and(|shard| !shard.has(folder)) {
            continue;
        }
        let (place, made_from) = (output.join(folder), format!("{of_all} {folder}"));
        let counted = format!("[{}/{}] {}", index + 1, folders.len(), photograph.name);
        let row = match finished(&place, &made_from).filter(|_| !args.common.run.force) {
            Some(row) => {
                progress.next(&format!("{counted}: finished before"));
                row
            }
            None => {
                // Those of an earlier run are of other maps than the photograph will have.
                let list = format!("{WORKSPACE}/{COLMAP_FUSION}");
                OF_ALL.iter().chain([&&*list]).for_each(|name| drop(fs::remove_file(output.join(name))));
                progress.next(&counted);
                let (name, start) = (&photograph.name, Instant::now());
                let mut row = PhotographRow { folder: Some(folder.clone()), ..PhotographRow::new(name) };
                let refined = OutputFolder::new(&place, true).and_then(|folder| {
                    job.produce(&mut prepared, index, name, &folder, progress, |path, refined, _| {
                        row.measure(refined);
                        row.seconds = start.elapsed().as_secs_f64();
                        mark(path, &made_from, &row)
                    })
                });
                match refined {
                    Ok(_) => row,
                    Err(error) if interrupt::requested() => return Err(error),
                    Err(error) => {
                        let seconds = start.elapsed().as_secs_f64();
                        PhotographRow { seconds, ..PhotographRow::failed(name, &message(&error)) }
                    }
                }
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
    let more = intervals(&settings.error_bar);
    if args.shard.is_some() {
        return finish(&rows, output, None, &Document::default(), &more, json!({}), progress);
    }
    rows.extend(scene.unreadable.iter().map(|(name, error)| PhotographRow::failed(name, error)));
    let maps = placed.iter().map(|(index, ..)| maps(&output.join(&folders[*index])));
    let maps = maps.collect::<Result<Vec<_>>>()?;
    let views = placed.iter().zip(&maps).map(|(&(index, camera, pose), (depth, sigma, png_scale))| {
        let image = scene.photographs[index].image.view();
        let map = DepthView { image, camera, pose, depth: depth.view(), sigma: sigma.view() };
        RefinedView { map, folder: &folders[index], png_scale: *png_scale }
    });
    let views: Vec<_> = views.collect();
    let points = write_all(output, &views, prepared.unit(), job.export)?;
    mde_prior::write_atomic(&output.join(INDEX), every_page(output, &rows)?.as_bytes())?;
    let input = args.capture.display().to_string();
    let Some(several) = prepared.several() else {
        bail!("{input}: one photograph; give two or more of one place")
    };
    let record = EveryRecord {
        about: About {
            warnings: &progress.warnings,
            total_seconds: progress.seconds(),
            ..about("dense", input, prepared.camera(), Some(settings), progress)
        },
        unit: prepared.unit(),
        photographs: &rows,
        poses: several.report(),
        points,
        prior_seconds,
    };
    write_json(&output.join(RECORD), &record)?;
    let tables = Document { blocks: vec![Block::Table(table(&rows))] };
    let more = format!("{points} points in {CLOUD}\n{more}");
    finish(&rows, output, Some(INDEX), &tables, &more, json!({ "points": points }), progress)
}

/// Depth, sigma and the scale of `depth.png` in the folder of a photograph; not all are in memory before.
fn maps(folder: &Path) -> Result<(Array2<f32>, Array2<f32>, f64)> {
    let map = |name: &str| read_values(folder.join(name), &ReadOptions::default());
    let scale = match png_content(folder.join("depth.png"))? {
        Some(PngContent::Depth { scale, .. }) => scale,
        _ => MILLIMETRES,
    };
    Ok((map("depth.npy")?, map("sigma.npy")?, scale))
}

fn table(rows: &[PhotographRow]) -> Table {
    let heads = ["photograph", "result", "verified, %", "sigma / depth, %", "seconds"];
    let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 1);
    let rows = rows.iter().map(|row| {
        vec![
            row.photograph.clone(),
            row.failed_or_alone().or_else(|| row.folder.clone()).unwrap_or_default(),
            percent(row.verified.map(f64::from)),
            percent(row.sigma),
            format!("{:.1}", row.seconds),
        ]
    });
    Table::new(2, heads, rows)
}
