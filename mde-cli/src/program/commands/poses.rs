//! `mde poses`: the poses of photographs.

use crate::config::Preset;
use crate::program::args::{PosesArgs, PresetArgs};
use crate::program::open::photographs::existing;
use crate::program::open::prior;
use crate::program::open::scene::{size, unposed};
use crate::program::open::settings::{settings, sizes};
use crate::program::progress::Progress;
use crate::program::store::folder::check_new_file;
use crate::program::terminal::line_of;
use crate::refiner::Refiner;
use crate::reports::capture::CaptureReport;
use anyhow::{Context, Result, ensure};
use mde_eval::table::{Block, Document, Table};
use mde_mvs::capture::{Distortion, Frame, Lens, transforms_json};
use serde_json::json;
use std::path::{Component, Path, PathBuf};

/// Longer side of the photographs, pixels, without `--max-size`: features are plenty, and matching stays fast.
const LONGER_SIDE: usize = 1024;

pub(super) fn run(args: &PosesArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let target = &args.run.output.clone().unwrap_or_else(|| "transforms.json".into());
    check_new_file("-o", target, args.run.force)?;
    let prior = prior::open(&args.prior, true)?;
    let mut settings = settings(&PresetArgs::default(), &args.size.memory, Preset::MultiView)?;
    settings.sizes = sizes(&args.size);
    settings.sizes.longest = settings.sizes.longest.or(Some(LONGER_SIDE));
    let refiner = Refiner::new(&prior, settings)?;
    let paths = existing("PHOTO", &args.photographs)?;
    ensure!(
        paths.len() > 1,
        "{}: one photograph has no parallax; give two or more, or a folder of them",
        paths.first().unwrap_or(&PathBuf::new()).display()
    );
    let folder = target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Names are checked before the work.
    paths.iter().try_for_each(|path| relative(path, folder).map(drop))?;
    let (scene, plan, paths) = unposed(&refiner, &args.camera, "PHOTO", None, paths, &mut progress)?;
    let prepared = refiner.prepare(&scene, &plan, &mut progress)?;
    let several = prepared.several().context("no photograph; give two or more")?;
    let report = several.report();
    ensure!(
        report.fallback.is_none(),
        "no poses were found, so nothing was written: {}",
        report.fallback.as_deref().unwrap_or_default()
    );
    let mut frames = Vec::new();
    for (index, path) in paths.iter().enumerate() {
        let (Some(pose), Some(camera)) = (several.pose(index), several.camera(index)) else { continue };
        let (height, width) = size(path);
        let lens = Lens { camera: camera.resized(width, height)?, distortion: Distortion::default() };
        frames.push(Frame { photograph: relative(path, folder)?.into(), lens, pose });
    }
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: can't make this folder", folder.display()))?;
    mde_prior::write_atomic(target, transforms_json(&frames, Path::new(""), |_| Vec::new()).as_bytes())?;

    let blocks = vec![Block::Table(table(report))];
    let focal = match report.focal_factor {
        Some(factor) if (factor - 1.0).abs() > 1e-9 => {
            format!("focal length: {factor:.3} of the assumed one\n")
        }
        _ => String::new(),
    };
    let count = format!("{} of {} photographs have a pose", frames.len(), scene.photographs.len());
    let text = format!("{focal}{count}\nwrote {} in {:.1} s", line_of(target), progress.seconds());
    let value = json!({ "event": "done", "output": target.display().to_string(), "photographs": report.photographs,
        "focal_factor": report.focal_factor, "poses_seconds": report.seconds.poses });
    progress.tables(&Document { blocks }, &text, value);
    Ok(())
}

/// One row per photograph.
fn table(report: &CaptureReport) -> Table {
    let heads = ["photograph", "verdict", "rotation, degrees", "baseline / depth", "matches"];
    let number =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
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

/// The path of an existing file as seen from `folder`, with `/` between its parts.
fn relative(path: &Path, folder: &Path) -> Result<String> {
    let absolute = |path: &Path| {
        // The folder may not exist yet.
        let existing = path.ancestors().find(|part| part.exists() && !part.as_os_str().is_empty());
        let existing = existing.unwrap_or(Path::new("."));
        let rest = path.strip_prefix(existing).unwrap_or(path);
        existing
            .canonicalize()
            .map(|found| if rest.as_os_str().is_empty() { found } else { found.join(rest) })
    };
    let fault = || format!("{}: can't be found; check the path", path.display());
    let (path, folder) = (absolute(path).with_context(fault)?, absolute(folder).with_context(fault)?);
    let common = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..");
    let down = path.components().skip(common).map(|part| {
        let name = match part {
            Component::Normal(name) => name.to_str(),
            other => other.as_os_str().to_str(),
        };
        name.with_context(|| {
            format!(
                "{}: the name is not UTF-8, which a transforms.json can't hold; rename it",
                path.display()
            )
        })
    });
    Ok(up.map(Ok).chain(down).collect::<Result<Vec<_>>>()?.join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_leads_from_the_folder_to_the_file() {
        let place = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(place.path().join("a/b")).unwrap();
        std::fs::write(place.path().join("a/b/c.png"), "").unwrap();
        let file = place.path().join("a/b/c.png");
        for (folder, expected) in
            [("a/b", "c.png"), ("a", "b/c.png"), ("", "a/b/c.png"), ("d/e", "../../a/b/c.png")]
        {
            assert_eq!(relative(&file, &place.path().join(folder)).unwrap(), expected);
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_name_that_json_cannot_hold_is_refused() {
        use std::os::unix::ffi::OsStrExt;
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join(std::ffi::OsStr::from_bytes(b"\xff.png"));
        std::fs::write(&file, "").unwrap();
        let fault = relative(&file, place.path()).unwrap_err().to_string();
        assert!(fault.contains("UTF-8"), "{fault}");
    }
}
