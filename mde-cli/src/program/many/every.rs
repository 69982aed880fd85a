//! Every photograph of a capture refined. The files of all of them, such as the poses and one cloud, are written at the end.

use crate::output::every::{CLOUD, EveryRecord, MESHES, PhotographRow, write_all};
use crate::output::export::colmap::FOLDER as WORKSPACE;
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::export::{Format, Placed};
use crate::output::names::folders;
use crate::output::record::{About, versions};
use crate::program::many::{finish, finished, mark};
use crate::program::report::{INDEX, every_page};
use crate::program::store::{OpenFolder, OutputFolder, RECORD};
use crate::program::{
    DenseArgs, Job, Partial, Progress, about, flags, interrupt, intervals, line_of, message, number,
    poses_of, write_json,
};
use crate::refiner::plan::{MOST_GATHERED, gathered_bytes};
use crate::refiner::{Observer, Plan};
use crate::scene::{Photograph, Scene};
use anyhow::{Result, bail};
use mde_eval::table::{Block, Document, Table};
use mde_mvs::capture::COLMAP_FUSION;
use mde_mvs::cloud::DepthView;
use mde_prior::format::{MILLIMETRES, PngContent, ReadOptions, png_content, read_values};
use mde_prior::resample::{nearest, shrink};
use mde_uncertainty::statistics::median;
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
    let surface = job.export.contains(&Format::Mesh);
    let gathered = |pixels| plan.shared.saturating_add(gathered_bytes(pixels, count as u64, surface));
    settings.memory.check(&format!("{count} photographs"), size.unwrap_or_default(), gathered)?;
    let _folder = OpenFolder::open(output, args.shard.is_some())?;
    // What is made of all photographs changes none of them.
    let of_each: Vec<_> = job.export.iter().filter(|format| !format.is_of_capture()).collect();
    let of_all = format!("{:?} {} {} {of_each:?}", versions(), job.refiner.identity()?, scene.identity()?);
    let mut prepared = job.refiner.prepare(scene, plan, progress)?;
    let prior_seconds = prepared.prior_seconds();
    let photographs = scene.photographs.iter().map(|photograph| Path::new(&photograph.name));
    let folders = folders(photographs, &OF_ALL);
    let (mut rows, mut placed, mut refining) = (Vec::<PhotographRow>::new(), Vec::new(), Vec::new());
    let is_here = |folder: &&String| args.shard.is_none_or(|shard| shard.has(folder));
    for (index, (photograph, folder)) in scene.photographs.iter().zip(&folders).enumerate() {
        if !is_here(&folder) {
            continue;
        }
        let (place, made_from) = (output.join(folder), format!("{of_all} {folder}"));
        let counted = format!("[{}/{}] {}", index + 1, folders.len(), photograph.name);
        let row = match finished(&place, &made_from).filter(|_| !args.common.run.force) {
            Some(row) => {
                progress.next(&format!("{counted}: finished before"), None);
                row
            }
            None => {
                // Those of an earlier run are of other maps than the photograph will have.
                let list = format!("{WORKSPACE}/{COLMAP_FUSION}");
                OF_ALL.iter().chain([&&*list]).for_each(|name| drop(fs::remove_file(output.join(name))));
                let rest = folders[index..].iter().filter(is_here).count();
                let left = median(refining.iter().copied()).map(|each| each * rest as f64);
                progress.next(&counted, left);
                let (name, start) = (&photograph.name, Instant::now());
                let mut row = PhotographRow { folder: Some(folder.clone()), ..PhotographRow::new(name) };
                let refined = OutputFolder::new(&place, true).and_then(|folder| {
                    job.produce(&mut prepared, index, name, &folder, progress, |path, refined, _| {
                        row.measure(refined);
                        row.seconds = start.elapsed().as_secs_f64();
                        mark(path, &made_from, &row)
                    })
                });
                refining.push(start.elapsed().as_secs_f64());
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
    let input = args.capture.display().to_string();
    let Some(poses) = prepared.several().map(|several| several.report().clone()) else {
        bail!("{input}: one photograph; give two or more of one place")
    };
    let (camera, unit) = (prepared.camera(), prepared.unit());
    // The maps of all take the place of priors and sweeps.
    drop(prepared);
    rows.extend(scene.unreadable.iter().map(|(name, error)| PhotographRow::failed(name, error)));
    let pixels: usize = placed.iter().map(|(_, camera, _)| camera.width * camera.height).sum();
    let share = (pixels as f64 / MOST_GATHERED).sqrt().max(1.0);
    if share > 1.0 {
        let [all, most] = [pixels as f64, MOST_GATHERED].map(|pixels| pixels / 1e6);
        progress.warn(format!(
            "the photographs have {all:.0} million pixels; {CLOUD} and the exports of all are made of {most:.0} million"
        ));
    }
    let small = |side: usize| ((side as f64 / share) as usize).max(1);
    let (mut positions, mut gathered) = (Vec::new(), Vec::new());
    for &(index, camera, pose) in &placed {
        let (folder, size) = (output.join(&folders[index]), (small(camera.height), small(camera.width)));
        let png_scale = match png_content(folder.join("depth.png"))? {
            Some(PngContent::Depth { scale, .. }) => scale,
            _ => MILLIMETRES,
        };
        positions.push(Placed { camera, pose, folder: &folders[index], png_scale });
        let map = |name: &str| -> Result<_> {
            Ok(nearest(read_values(folder.join(name), &ReadOptions::default())?.view(), size))
        };
        let image = scene.photographs[index].image.read()?;
        let image = if share > 1.0 { shrink(image.view(), size).into_shared() } else { image };
        gathered.push((image, camera.resized(size.1, size.0)?, map("depth.npy")?, map("sigma.npy")?));
    }
    let views = gathered.iter().zip(&positions).map(|((image, camera, depth, sigma), placed)| DepthView {
        image: image.view(),
        camera: *camera,
        pose: placed.pose,
        depth: depth.view(),
        sigma: sigma.view(),
    });
    let views: Vec<_> = views.collect();
    let points = write_all(output, (&positions, &views), unit, job.export)?;
    mde_prior::write_atomic(&output.join(INDEX), every_page(output, &rows)?.as_bytes())?;
    let record = EveryRecord {
        about: About {
            warnings: &progress.warnings,
            total_seconds: progress.seconds(),
            ..about("dense", input, &camera, Some(settings), progress)
        },
        unit,
        photographs: &rows,
        poses: &poses,
        points,
        prior_seconds,
    };
    write_json(&output.join(RECORD), &record)?;
    let tables = Document { blocks: vec![Block::Table(table(&rows))] };
    let (camera, poses) = (flags(&camera.title()), poses_of(&poses));
    let more = format!("camera: {camera}\nunit: {unit}; {poses}\n{points} points in {CLOUD}\n{more}");
    finish(&rows, output, Some(INDEX), &tables, &more, json!({ "points": points }), progress)?;
    let alone = rows.iter().find_map(|row| row.reason.clone()).filter(|_| placed.is_empty());
    alone.map_or(Ok(()), |reason| Err(Partial::Alone { reason, folder: line_of(output) }.into()))
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
