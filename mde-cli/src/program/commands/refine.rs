use crate::program::args::RefineArgs;
use crate::program::open::{capture, photographs};
use crate::program::open::opened::{Opening, settings, use_threads};
use crate::program::open::prior::NamedPrior;
use crate::program::open::size::limit;
use crate::program::open::truth::Truth;
use crate::program::store::folder::OutputFolder;
use crate::program::many;
use crate::program::many::item::settings_of;
use crate::program::many::every;
use crate::program::job::Job;
use crate::program::progress::Progress;
use anyhow::{Result, ensure};
use crate::refiner::known::Known;
use crate::naming::Naming;
use crate::config::Preset;

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
    let output = args.run.output(&args.image, "-depth");
    let folder = match args.several.all {
        true => every::check_folder(&output).map(|()| None)?,
        false => Some(OutputFolder::new(&output, args.run.force)?),
    };
    let usual = if args.several.views.is_empty() { Preset::Default } else { Preset::MultiView };
    let (preset, mut config) = settings(&args.settings, usual)?;
    if let Some(most) = args.several.max_views {
        config.multi_view.max_views = most.into();
    }
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
    let made_from = match &capture {
        Some(capture) if args.several.all => {
            every::made_from(&settings_of(args, preset, &config, &named)?, args.several.unit, capture)
        }
        _ => String::new(),
    };
    let job = Job {
        command: "refine",
        input: name,
        prior,
        preset,
        config,
        truth: Truth::open(&args.truth, opened.original, opened.of_results())?,
        at_once,
        save_field: args.save_field,
        error_bar: args.error_bar.open()?,
        export: args.export.export.clone(),
        capture,
        unit: args.several.unit,
        known,
        same_scale: None,
        keep_photographs: false,
        opened,
    };
    match folder {
        None => every::run(&job, &output, &made_from, args.run.force, &mut progress),
        Some(folder) => job.run(&folder, &mut progress),
    }
}
