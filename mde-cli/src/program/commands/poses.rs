use crate::program::args::PosesArgs;
use crate::program::open::capture::photographs;
use crate::program::open::opened::use_threads;
use crate::program::open::prior::NamedPrior;
use crate::program::open::size::limit;
use crate::program::store::folder::check_new_file;
use crate::program::open::relative::relative;
use crate::program::progress::Progress;
use anyhow::{Context, Result, ensure};
use crate::reports::capture::CaptureReport;
use crate::config::Config;
use crate::several::prepared::PreparedCapture;
use crate::refinement::stages::Stages;
use mde_eval::table::{Block, Cell, Column, Document, Table};
use mde_mvs::capture::{Distortion, Frame, Lens, transforms_json};
use serde_json::json;
use std::path::Path;

/// Longer side of the photographs, pixels, without `--max-size`: features are plenty, and matching stays fast.
const LONGER_SIDE: u32 = 1024;

pub(super) fn run(args: &PosesArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let target = &args.run.output.clone().unwrap_or_else(|| "transforms.json".into());
    check_new_file("-o", target, args.run.force)?;
    let config = Config::default();
    let mut size = args.size.clone();
    size.max_size = size.max_size.or(Some(LONGER_SIDE));
    let (capture, files, first) = photographs(args, &size, &config, &mut progress)?;
    let folder = target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Names are checked before the work.
    let names = files.iter().map(|(path, _)| relative(path, folder)).collect::<Result<Vec<_>>>()?;
    let prior = NamedPrior::open(&args.prior)?;
    let prior = prior.bind(&first, &mut progress)?;
    let limit = limit(&size.memory);
    let at_once = first.predictions_at_once_of(capture.photographs.len(), &prior, &limit)?;
    let stages = Stages::new(&prior).with_predictions_at_once(at_once);
    let prepared = PreparedCapture::new(&capture, &stages, &config, &mut |event| progress.observe(event))?;
    let report = prepared.report();
    ensure!(
        report.fallback.is_none(),
        "no poses were found, so nothing was written: {}",
        report.fallback.as_deref().unwrap_or_default()
    );
    let mut frames = Vec::new();
    for (index, (name, (_, [width, height]))) in names.into_iter().zip(&files).enumerate() {
        let (Some(pose), Some(camera)) = (prepared.pose(index), prepared.camera(index)) else { continue };
        let camera = camera.resized(*width, *height)?;
        let lens = Lens { camera, distortion: Distortion::default() };
        frames.push(Frame { photograph: name.into(), lens, pose });
    }
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: can't make this folder", folder.display()))?;
    mde_prior::write_atomic(target, transforms_json(&frames, Path::new("")).as_bytes())?;

    let blocks = vec![Block::Table(table(report))];
    let focal = match report.focal_factor {
        Some(factor) if (factor - 1.0).abs() > 1e-9 => {
            format!("focal length: {factor:.3} of the assumed one\n")
        }
        _ => String::new(),
    };
    let count = format!("{} of {} photographs have a pose", frames.len(), capture.photographs.len());
    let text = format!("{focal}{count}\nwrote {} in {:.1} s", target.display(), progress.seconds());
    let value = json!({ "event": "done", "output": target.display().to_string(), "photographs": report.photographs,
        "focal_factor": report.focal_factor, "poses_seconds": report.seconds.poses });
    progress.tables(&Document { blocks }, &text, value);
    Ok(())
}

/// One row per photograph.
fn table(report: &CaptureReport) -> Table {
    let columns = vec![
        Column::text("photograph"),
        Column::text("verdict"),
        Column::number("rotation, degrees"),
        Column::number("baseline / depth"),
        Column::number("matches"),
    ];
    let number = |value: Option<f64>, digits: usize| {
        Cell::new(value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}")))
    };
    let rows = report.photographs.iter().map(|photograph| {
        vec![
            Cell::new(photograph.name.clone()),
            Cell::new(photograph.verdict.clone()),
            number(photograph.rotation_degrees, 2),
            number(photograph.parallax, 3),
            number(photograph.matches.map(|count| count as f64), 0),
        ]
    });
    Table { columns, rows: rows.collect() }
}
