use crate::program::args::WarpArgs;
use crate::program::open::opened::{Opening, settings, use_threads};
use crate::program::open::prior::NamedPrior;
use crate::program::open::size::check_memory;
use crate::program::store::folder::{OutputFolder, RECORD};
use crate::program::provenance::{about, write_json};
use crate::program::progress::Progress;
use anyhow::{Result, ensure};
use crate::scene::photograph::Opened;
use crate::prior::origin::PriorOrigin;
use crate::refiner::plan::refine_bytes;
use crate::refinement::predict::known;
use crate::refinement::views::synthesise;
use crate::output::record::About;
use crate::output::preview::contact_sheet;
use crate::naming::Naming;
use crate::config::Preset;
use crate::reports::iteration::WarpReport;
use mde_prior::DepthPrior;
use mde_prior::format::write_npy;
use mde_prior::photo::{write_image, write_rgb_png};
use mde_warp::PosedView;
use ndarray::Array3;
use serde::Serialize;
use serde_json::json;
use std::path::Path;

#[derive(Serialize)]
struct WarpRecord<'r> {
    #[serde(flatten)]
    about: About<'r>,
    prior: &'r PriorOrigin,
    warp: WarpReport,
}

/// One view in `poses.json`.
#[derive(Serialize)]
struct ViewRecord {
    image: String,
    mask: String,
    depth: String,
    /// Row by row.
    world_to_camera: [[f64; 4]; 4],
    /// Share of the pixels that may be trained on.
    trainable: f64,
}

pub(super) fn run(args: &WarpArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(&args.image, "-views"), args.run.force)?;
    let (preset, config) = settings(&args.settings, Preset::Default)?;
    // Views are not brought back to a larger size.
    let opening = Opening { size: &args.size, camera: &args.camera, several: true };
    let mut opened = opening.open(&args.image, &mut progress)?;
    let what = args.image.display().to_string();
    check_memory(&args.size.memory, &what, opened.size(), |pixels| refine_bytes(pixels, &config))?;
    let (height, width) = opened.size();
    let named = NamedPrior::open(&args.prior)?;
    let prior = named.bind(&opened, &mut progress)?;
    opened.take_camera_of(&prior, &named.origin)?;
    let Opened { image, camera, .. } = opened;
    if let Some(warning) = camera.warning(Naming::Flags) {
        progress.warn(warning);
    }
    let prior = prior.at_focal(camera.focal());
    progress.step("prior");
    let depth = prior.predict(image.view())?.to_depth(&config.disparity)?;
    ensure!(depth.dim() == (height, width), "the prior is not of the image's size; make both the same");
    progress.step("warp");
    let (views, warp) = synthesise(image.view(), &camera.camera, &known(depth)?, &config, 0)?;
    folder.write(|path| {
        write_views(path, &views)?;
        mde_prior::write_atomic(&path.join("config.toml"), config.to_toml()?.as_bytes())?;
        let about = About {
            preset: Some(preset.name()),
            seed: Some(config.seed),
            warnings: progress.warnings(),
            total_seconds: progress.seconds(),
            ..about("warp", args.image.display().to_string(), &camera)
        };
        write_json(&path.join(RECORD), &WarpRecord { about, prior: prior.origin(), warp })
    })?;
    let text = format!(
        "{} views, holes {:.2} % (at most {:.2} %), outside the image {:.2} %\nwrote {}",
        warp.views,
        100.0 * warp.mean_hole_fraction,
        100.0 * warp.max_hole_fraction,
        100.0 * warp.mean_outside_fraction,
        folder.path().display()
    );
    progress.result(
        &text,
        json!({ "event": "done", "output": folder.path().display().to_string(), "warp": warp }),
    );
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
        let world_to_camera = crate::program::commands::rows(&view.pose);
        records.push(ViewRecord { image, mask, depth, world_to_camera, trainable });
    }
    write_json(&folder.join("poses.json"), &records)?;
    Ok(write_rgb_png(folder.join("contact.png"), contact_sheet(views).pixels())?)
}
