//! `mde warp`: the synthetic views of a photograph.

use crate::config::Preset;
use crate::output::preview::contact_sheet;
use crate::program::open::{Opener, prior, settings, sizes};
use crate::program::store::OutputFolder;
use crate::program::{Progress, WarpArgs, about, line_of, write_json, write_record};
use crate::refiner::Refiner;
use anyhow::Result;
use mde_eval::table::Document;
use mde_prior::format::write_npy;
use mde_prior::photo::{write_image, write_rgb_png};
use mde_warp::{PosedView, matrix_rows};
use ndarray::Array3;
use serde_json::json;
use std::path::Path;

pub(super) fn run(args: &WarpArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(&args.image, "-views"), args.run.force)?;
    let prior = prior::open(&args.prior, false)?;
    let mut settings = settings(&args.settings, &args.size.memory, Preset::Paper)?;
    settings.sizes = sizes(&args.size);
    let refiner = Refiner::new(&prior, settings)?;
    // Views are not brought back to a larger size.
    let (scene, plan) =
        Opener { refiner: &refiner, camera: &args.camera, progress: &mut progress }.one(&args.image, true)?;
    let prepared = refiner.prepare(&scene, &plan, &mut progress)?;
    progress.step("warp");
    let (views, warp) = prepared.synthetic_views()?;
    folder.write(|path| {
        write_views(path, &views)?;
        mde_prior::write_atomic(&path.join("config.toml"), refiner.settings().config.to_toml()?.as_bytes())?;
        let input = args.image.display().to_string();
        let camera = prepared.camera();
        let about = about("warp", input, &camera, Some(refiner.settings()), &progress);
        write_record(path, about, json!({ "prior": prepared.origin(), "warp": warp }))
    })?;
    let text = format!(
        "{} views, holes {:.2} % (at most {:.2} %), outside the image {:.2} %\nwrote {}",
        warp.views,
        100.0 * warp.mean_hole_fraction,
        100.0 * warp.max_hole_fraction,
        100.0 * warp.mean_outside_fraction,
        line_of(folder.path())
    );
    progress.done(&Document::default(), &text, folder.path(), json!({ "warp": warp }));
    Ok(())
}

fn write_views(folder: &Path, views: &[PosedView]) -> Result<()> {
    let mut records = Vec::new();
    for (index, view) in views.iter().enumerate() {
        let (image, mask, depth) =
            (format!("view_{index:02}.png"), format!("mask_{index:02}.png"), format!("depth_{index:02}.npy"));
        write_image(folder.join(&image), view.image.view())?;
        let (height, width) = view.mask.dim();
        let white = Array3::from_shape_fn((height, width, 3), |(y, x, _)| 255 * u8::from(view.mask[(y, x)]));
        write_rgb_png(folder.join(&mask), white.view())?;
        if let Some(hypothesis) = view.hypotheses.first() {
            write_npy(folder.join(&depth), hypothesis.mean())?;
        }
        let trainable = view.mask.iter().filter(|real| **real).count() as f64 / view.mask.len() as f64;
        // The matrix row by row, and the share of the pixels that may be trained on.
        records.push(json!({ "image": image, "mask": mask, "depth": depth,
            "world_to_camera": matrix_rows(&view.pose), "trainable": trainable }));
    }
    write_json(&folder.join("poses.json"), &records)?;
    Ok(write_rgb_png(folder.join("contact.png"), contact_sheet(views).view())?)
}
