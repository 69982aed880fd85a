use crate::config::Preset;
use crate::program::args::DenseArgs;
use crate::program::job::Job;
use crate::program::many::every;
use crate::program::open::settings::refinement_settings;
use crate::program::open::{prior, scene};
use crate::program::progress::Progress;
use crate::refiner::Refiner;
use anyhow::{Result, ensure};

pub(super) fn run(args: &DenseArgs) -> Result<()> {
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
    let (scene, plan) = scene::several(&refiner, &args.common.camera, None, capture, &mut progress)?;
    let export = &args.common.results.export;
    let job = Job { command: "dense", refiner: &refiner, export, truth: None, keep_photographs: false };
    every::run(&job, &scene, &plan, args, &output, &mut progress)
}
