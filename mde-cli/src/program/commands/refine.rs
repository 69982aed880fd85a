//! `mde refine` and `mde dense`.

use crate::config::Preset;
use crate::program::many::{self, every};
use crate::program::open::{Opener, photographs, prior, refinement_settings};
use crate::program::store::OutputFolder;
use crate::program::{DenseArgs, Job, Partial, Progress, RefineArgs, Truth, line_of};
use crate::refiner::Refiner;
use crate::scene::KnownDepths;
use anyhow::{Result, ensure};

pub(super) fn refine(args: &RefineArgs) -> Result<()> {
    if photographs::are_many(&args.photographs()) || args.shard.is_some() {
        return many::run(args, &mut Progress::start_with(&args.common.run, true)?);
    }
    let mut progress = Progress::start(&args.common.run)?;
    ensure!(
        !args.same_scale,
        "--same-scale: one photograph has no scale in common with another; give several, or a folder, or leave it out"
    );
    let output = args.common.run.output(&args.image, "-depth");
    let folder = OutputFolder::new(&output, args.common.run.force)?;
    let prior = prior::open(&args.common.prior, !args.views.is_empty())?;
    let usual = if args.views.is_empty() { Preset::Default } else { Preset::MultiView };
    let refiner = Refiner::new(&prior, refinement_settings(&args.common, usual)?)?;
    let mut opener = Opener { refiner: &refiner, camera: &args.common.camera, progress: &mut progress };
    let (mut scene, plan) = match args.views.is_empty() {
        false => opener.several(Some(&args.image), &args.views)?,
        true => opener.one(&args.image, false)?,
    };
    let input = args.image.display().to_string();
    let reference = &scene.photographs[0];
    let original = reference.original;
    let truth =
        args.gt.as_deref().map(|path| Truth::open(path, original, reference.of_results())).transpose()?;
    if let Some(path) = &args.scale_from {
        scene.known = Some(KnownDepths::open(path, &args.image, original)?);
    }
    let job = Job {
        command: "refine",
        refiner: &refiner,
        export: &args.common.results.export,
        truth,
        keep_photographs: false,
    };
    let unused = job.run(&scene, &plan, &input, &folder, &mut progress)?;
    let folder = line_of(folder.path());
    unused
        .map_or(Ok(()), |reason| Err(Partial::Alone { reason: format!("--views: {reason}"), folder }.into()))
}

pub(super) fn dense(args: &DenseArgs) -> Result<()> {
    let mut progress = Progress::start(&args.common.run)?;
    ensure!(
        args.common.prior.prior_depth.is_none(),
        "--prior-depth: is the map of one photograph; give --prior-model, or nothing"
    );
    let output = args.common.run.output(&args.capture, "-dense");
    every::check_folder(&output)?;
    let prior = prior::open(&args.common.prior, true)?;
    let capture = std::slice::from_ref(&args.capture);
    let refiner = Refiner::new(&prior, refinement_settings(&args.common, Preset::MultiView)?)?;
    let mut opener = Opener { refiner: &refiner, camera: &args.common.camera, progress: &mut progress };
    let (mut scene, plan) = opener.several(None, capture)?;
    scene.every = true;
    let export = &args.common.results.export;
    let job = Job { command: "dense", refiner: &refiner, export, truth: None, keep_photographs: false };
    every::run(&job, &scene, &plan, args, &output, &mut progress)
}
