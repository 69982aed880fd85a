use crate::program::args::RefineArgs;
use crate::program::open::{capture, photographs};
use crate::program::open::opened::{Opening, settings, use_threads};
use crate::program::open::prior::NamedPrior;
use crate::program::open::size::limit;
use crate::program::open::truth::Truth;
use crate::program::store::folder::OutputFolder;
use crate::output::record::versions;
use crate::program::{recording, many};
use crate::program::checkpoint::Checkpoints;
use crate::program::many::every;
use crate::program::job::Job;
use crate::program::progress::Progress;
use anyhow::{Context, Result, ensure};
use crate::scene::known::Known;
use crate::scene::photograph::Opened;
use crate::prior::origin::PriorOrigin;
use crate::several::Capture;
use crate::config::{Config, Preset};
use crate::naming::Naming;
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
    let several = !args.several.views.is_empty();
    let opening = Opening { size: &args.size, camera: &args.camera, several };
    let mut opened = opening.open(&args.image, &mut progress)?;
    let named = NamedPrior::open(&args.prior)?;
    let prior = named.bind(&opened, &mut progress)?;
    let (name, limit) = (args.image.display().to_string(), limit(&args.size.memory));
    let alone = match several {
        false => Some(opened.predictions_at_once(&name, &config, &prior, &limit)?),
        true => None,
    };
    let capture = capture::open(args, &mut opened, &config, &mut progress)?;
    let at_once = match (alone, &capture) {
        (Some(at_once), _) => at_once,
        (None, Some(capture)) => opened.predictions_at_once_of(capture.photographs.len(), &prior, &limit)?,
        (None, None) => 1,
    };
    named.exchanged().into_iter().for_each(|warning| progress.warn(warning.to_owned()));
    // Further photographs give the focal length.
    if capture.is_none() {
        opened.take_camera_of(&prior, &named.origin)?;
    }
    let prior = prior.at_focal(opened.camera.focal());
    let known = match &args.scale_from {
        Some(path) => Some(Known::open(path, &args.image, opened.original, Naming::Flags)?),
        None => None,
    };
    let made_from = match args.resume {
        true => Some(made_from(args, &opened, prior.origin(), &config, capture.as_ref())?),
        false => None,
    };
    let checkpoints = match &made_from {
        Some(made_from) if !args.several.all => Some(Checkpoints::new(folder.path(), made_from.clone())?),
        _ => None,
    };
    let job = Job {
        command: "refine",
        input: name,
        prior,
        preset,
        config,
        truth: Truth::open(&args.truth, opened.original, opened.of_results())?,
        budget: args.settings.budget.map(Duration::from_secs_f64),
        at_once,
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
        opened,
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
    origin: &PriorOrigin,
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
    let mut made_from = json!({
        "versions": versions(), "config": config.to_toml()?, "image": checksum(&opened.image), "size": opened.size(), "budget": args.settings.budget,
        "camera": opened.camera.camera, "prior": (origin.kind, &origin.model, &origin.model_hash, &origin.runtime), "prior_file": crc32fast::hash(&file),
        "prior_scale": args.prior.png_scale, "prior_encoding": format!("{:?}", args.prior.prior_encoding),
    });
    // Whole results are kept with --all, not only states of the loop.
    if !photographs.is_empty() {
        made_from["photographs"] = json!(photographs);
        made_from["output"] = json!(format!(
            "{:?}",
            (
                args.several.unit,
                args.several.matches,
                &args.error_bar,
                &args.export.export,
                args.export.y_up,
                args.save_field
            )
        ));
    }
    // As text: numbers that are read again may differ in their last bit.
    Ok(Value::String(made_from.to_string()))
}
