//! `mde poses`: the poses of photographs.

use crate::config::Preset;
use crate::program::open::scene::size;
use crate::program::open::{Opener, existing, limit, prior, sizes};
use crate::program::store::{NewFolder, check_new_file, parent};
use crate::program::{PosesArgs, Progress, flags, line_of, number};
use crate::refiner::{Observer, Refiner, Settings};
use crate::reports::CaptureReport;
use anyhow::{Context, Result, bail, ensure};
use mde_eval::table::{Block, Document, Table};
use mde_mvs::capture::{Distortion, Frame, Lens, relative_path, transforms_json};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Longer side of the photographs, pixels, without `--max-size`: features are plenty, and matching stays fast.
const LONGER_SIDE: usize = 1024;

pub(super) fn run(args: &PosesArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let target = &args.run.output.clone().unwrap_or_else(|| "transforms.json".into());
    check_new_file("-o", target, args.run.force)?;
    let prior = prior::open(&args.prior, true)?;
    let mut sizes = sizes(&args.size);
    sizes.longest.get_or_insert(LONGER_SIDE);
    let memory = limit(&args.size.memory);
    let refiner = Refiner::new(&prior, Settings { sizes, memory, ..Settings::new(Preset::MultiView) })?;
    let paths = existing("PHOTO", &args.photographs)?;
    ensure!(
        paths.len() > 1,
        "{}: one photograph has no parallax; give two or more, or a folder of them",
        paths.first().unwrap_or(&PathBuf::new()).display()
    );
    let folder = parent(target);
    let _made = NewFolder::make(folder)?;
    // Names are checked before the work.
    paths.iter().try_for_each(|path| relative(path, folder).map(drop))?;
    let mut opener = Opener { refiner: &refiner, camera: &args.camera, progress: &mut progress };
    let (mut scene, plan, paths) = opener.unposed("PHOTO", None, paths)?;
    scene.every = true;
    let prepared = refiner.prepare(&scene, &plan, &mut progress)?;
    let several = prepared.several().context("no photograph; give two or more")?;
    let report = several.report();
    if let Some(reason) = &report.fallback {
        bail!("no poses were found, so nothing was written: {reason}");
    }
    let mut frames = Vec::new();
    for (index, path) in paths.iter().enumerate() {
        let (Some(pose), Some(camera)) = (several.pose(index), several.camera(index)) else { continue };
        let (height, width) = size(path);
        let lens = Lens { camera: camera.resized(width, height)?, distortion: Distortion::default() };
        frames.push(Frame { photograph: relative(path, folder)?.into(), lens, pose });
    }
    report.lens_warning().into_iter().for_each(|warning| progress.warn(warning));
    mde_prior::write_atomic(target, transforms_json(&frames, Path::new(""), |_| Vec::new()).as_bytes())?;

    let unread = Some(scene.unreadable.len()).filter(|count| *count > 0);
    let unread = unread.map_or_else(String::new, |count| format!(", {count} can't be read"));
    let count = format!("{} of {} photographs have a pose{unread}", frames.len(), scene.photographs.len());
    // At the size of the file, as in the transforms.json.
    let original = scene.photographs[several.reference()].original;
    let camera = flags(&prepared.camera().resized(original)?.title());
    let text = format!("camera: {camera}\n{count}\nwrote {} in {:.1} s", line_of(target), progress.seconds());
    let value = json!({ "photographs": report.photographs, "focal_factor": report.focal_factor, "focal_sigma": report.focal_sigma,
        "poses_seconds": report.seconds.poses });
    progress.done(&Document { blocks: vec![Block::Table(table(report))] }, &text, target, value);
    Ok(())
}

fn table(report: &CaptureReport) -> Table {
    let heads = ["photograph", "verdict", "rotation, degrees", "baseline / depth", "matches"];
    let rows = report.photographs.iter().map(|photograph| {
        vec![
            photograph.name.clone(),
            photograph.verdict.clone(),
            number(photograph.rotation_degrees, 2),
            number(photograph.parallax, 3),
            number(photograph.matches.map(|count| count as f64), 0),
        ]
    });
    Table::new(2, heads, rows)
}

/// The path of a file as seen from `folder`.
fn relative(path: &Path, folder: &Path) -> Result<String> {
    let shown = path.display();
    let found =
        relative_path(path, folder).with_context(|| format!("{shown}: can't be found; check the path"))?;
    found.with_context(|| {
        format!("{shown}: the name is not UTF-8, which a transforms.json can't hold; rename it")
    })
}
