use crate::args::RefineArgs;
use crate::input::camera::KnownCamera;
use crate::input::capture;
use crate::input::opened::{Opened, open_image, settings, use_threads};
use crate::input::prior::NamedPrior;
use crate::input::truth::Truth;
use crate::output::folder::OutputFolder;
use crate::output::provenance::versions;
use crate::output::recording;
use crate::run::checkpoint::Checkpoints;
use crate::run::error_bar::ErrorBar;
use crate::run::job::Job;
use crate::run::progress::Progress;
use anyhow::{Context, Result};
use mde_cli::{Config, Preset};
use serde_json::{Value, json};

pub(super) fn run(args: &RefineArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output, args.run.force)?;
    let recording = recording::open(&args.export, args.run.force)?;
    let usual = if args.views.is_empty() { Preset::Default } else { Preset::MultiView };
    let (preset, config) = settings(&args.settings, usual)?;
    let mut opened = open_image(&args.image, &args.size, &config, &mut progress)?;
    let mut camera = KnownCamera::new(&args.camera, opened.photo.focal_35mm, &opened)?;
    let capture = capture::open(args, &mut opened, &mut camera, &config, &mut progress)?;
    // Further photographs without poses give the focal length.
    if let Some(warning) = camera.warning().filter(|_| capture.is_none()) {
        progress.warn(warning);
    }
    let prior = NamedPrior::open(&args.prior)?.resized(&opened)?;
    let checkpoints = match args.resume {
        true => Some(Checkpoints::new(folder.path(), made_from(args, &opened, &camera, &prior, &config)?)),
        false => None,
    };
    let job = Job {
        command: "refine",
        input: args.image.display().to_string(),
        camera,
        prior,
        preset,
        config,
        truth: Truth::open(&args.truth, &opened)?,
        save_field: args.save_field,
        checkpoints,
        error_bar: ErrorBar::open(&args.error_bar)?,
        export: args.export.export.clone(),
        recording,
        capture,
        keep_photographs: false,
        image: opened.photo.pixels,
    };
    job.run(&folder, &mut progress)
}

/// Everything that the maps depend on.
fn made_from(
    args: &RefineArgs,
    opened: &Opened,
    camera: &KnownCamera,
    prior: &NamedPrior,
    config: &Config,
) -> Result<Value> {
    let mut hasher = crc32fast::Hasher::new();
    opened.photo.pixels.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    let file = args.prior.source.prior_model.as_ref().or(args.prior.source.prior_depth.as_ref());
    let file = match file {
        Some(path) => std::fs::read(path).with_context(|| path.display().to_string())?,
        None => Vec::new(),
    };
    Ok(json!({
        "versions": versions(), "config": config.to_toml()?, "image": hasher.finalize(), "size": opened.size,
        "camera": camera.camera, "prior": prior.origin, "prior_file": crc32fast::hash(&file),
        "prior_scale": args.prior.png_scale, "prior_encoding": format!("{:?}", args.prior.prior_encoding),
    }))
}
