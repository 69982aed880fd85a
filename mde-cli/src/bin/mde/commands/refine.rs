use crate::args::RefineArgs;
use crate::input::camera::{self, KnownCamera};
use crate::input::capture;
use crate::input::opened::{
    Opened, open_image, predictions_at_once, predictions_at_once_of, settings, use_threads,
};
use crate::input::photographs;
use crate::input::prior::NamedPrior;
use crate::input::truth::Truth;
use crate::output::folder::OutputFolder;
use crate::output::provenance::versions;
use crate::output::recording;
use crate::run::batch;
use crate::run::checkpoint::Checkpoints;
use crate::run::every;
use crate::run::job::{Full, Job};
use crate::run::progress::Progress;
use anyhow::{Context, Result, ensure};
use mde_cli::inputs::Known;
use mde_cli::{Capture, Config, Naming, Preset};
use ndarray::Array3;
use serde_json::{Value, json};
use std::time::Duration;

pub(super) fn run(args: &RefineArgs) -> Result<()> {
    if photographs::are_many(&args.photographs()) || args.several.shard.is_some() {
        return batch::run(args);
    }
    ensure!(
        !args.several.same_scale,
        "--same-scale: one photograph has no scale in common with another; give several, or a folder, or leave it out"
    );
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(&args.image, "-depth"), args.run.force)?;
    let recording = recording::open(&args.export, args.run.force)?;
    let usual = if args.several.views.is_empty() { Preset::Default } else { Preset::MultiView };
    let (preset, mut config) = settings(&args.settings, usual)?;
    if let Some(most) = args.several.max_views {
        config.multi_view.max_views = most.into();
    }
    ensure!(
        !args.resume || args.several.views.is_empty() || args.several.all,
        "--resume: one photograph with --views has no state between its start and its end to resume from; leave --resume out, or \
         refine them all with --all"
    );
    let mut opened = open_image(&args.image, &args.size, &mut progress)?;
    let prior = NamedPrior::open(&args.prior)?;
    let mut full = None;
    if args.several.views.is_empty() {
        if let Some(working) = opened.working(&args.size) {
            let camera = camera::known(&args.camera, opened.photo.focal_35mm, &opened)?;
            full = Some(Full { image: std::mem::replace(&mut opened, working).photo.pixels, camera });
        }
    } else {
        opened = opened.reduced(&args.size);
    }
    let size = full.as_ref().map_or(opened.size, Full::size);
    let alone = match args.several.views.is_empty() {
        true => Some(predictions_at_once(&args.image, size, &args.size, &config, &*prior.prior)?),
        false => None,
    };
    let mut camera = camera::known(&args.camera, opened.photo.focal_35mm, &opened)?;
    let capture = capture::open(args, &mut opened, &mut camera, &config, &mut progress)?;
    let at_once = match (alone, &capture) {
        (Some(at_once), _) => at_once,
        (None, Some(capture)) => predictions_at_once_of(capture, opened.size, &args.size, &*prior.prior)?,
        (None, None) => 1,
    };
    let prior = prior.resized(&opened, &mut progress)?;
    // Further photographs without poses give the focal length.
    if capture.is_none() {
        if let Some(own) = prior.camera(opened.photo.pixels.view(), &camera)? {
            if let Some(full) = &mut full {
                full.take_camera(&own)?;
            }
            camera = own;
        }
        camera.warning(Naming::Flags).into_iter().for_each(|warning| progress.warn(warning));
    }
    let prior = prior.for_camera(&camera);
    let known = match &args.scale_from {
        Some(path) => Some(Known::open(path, &args.image, opened.original, Naming::Flags)?),
        None => None,
    };
    let made_from = match args.resume {
        true => Some(made_from(args, &opened, &camera, &prior, &config, capture.as_ref())?),
        false => None,
    };
    let checkpoints = match &made_from {
        Some(made_from) if !args.several.all => Some(Checkpoints::new(folder.path(), made_from.clone())?),
        _ => None,
    };
    let job = Job {
        command: "refine",
        input: args.image.display().to_string(),
        camera,
        prior,
        preset,
        config,
        truth: Truth::open(&args.truth, opened.original, full.as_ref().map_or(opened.size, Full::size))?,
        budget: args.settings.budget.map(Duration::from_secs_f64),
        at_once,
        full,
        save_field: args.save_field,
        checkpoints,
        error_bar: args.error_bar.open()?,
        export: args.export.export.clone(),
        y_up: args.export.y_up,
        recording,
        capture,
        unit: args.several.unit,
        known,
        same_scale: None,
        keep_photographs: false,
        image: opened.photo.pixels,
    };
    match args.several.all {
        true => every::run(&job, &folder, made_from, &mut progress),
        false => job.run(&folder, &mut progress),
    }
}

/// Everything that the maps depend on.
fn made_from(
    args: &RefineArgs,
    opened: &Opened,
    camera: &KnownCamera,
    prior: &NamedPrior<'_>,
    config: &Config,
    capture: Option<&Capture>,
) -> Result<Value> {
    let checksum = |image: &Array3<f32>| {
        let mut hasher = crc32fast::Hasher::new();
        image.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
        hasher.finalize()
    };
    let photographs: Vec<Value> = capture
        .iter()
        .flat_map(|capture| &capture.photographs)
        .map(|p| {
            let pose = p.pose.as_ref().map(super::rows);
            json!([
                p.name,
                checksum(&p.image),
                p.mask.iter().filter(|m| **m).count(),
                p.camera,
                p.focal_assumed,
                pose
            ])
        })
        .collect();
    // The content of the prior's files, not their place. A model's hash is in its origin.
    let file = match &args.prior.source.prior_depth {
        Some(path) => std::fs::read(path).with_context(|| path.display().to_string())?,
        None => Vec::new(),
    };
    let origin = &prior.origin;
    let mut made_from = json!({
        "versions": versions(), "config": config.to_toml()?, "image": checksum(&opened.photo.pixels), "size": opened.size, "budget": args.settings.budget,
        "camera": camera.camera, "prior": (origin.kind, &origin.model, &origin.model_hash, &origin.runtime), "prior_file": crc32fast::hash(&file),
        "prior_scale": args.prior.png_scale, "prior_encoding": format!("{:?}", args.prior.prior_encoding),
    });
    // Whole results are kept with --all, not only states of the loop.
    if !photographs.is_empty() {
        made_from["photographs"] = json!(photographs);
        made_from["output"] = json!(format!(
            "{:?}",
            (args.several.unit, &args.error_bar, &args.export.export, args.export.y_up, args.save_field)
        ));
    }
    // As text: numbers that are read again may differ in their last bit.
    Ok(Value::String(made_from.to_string()))
}
