use crate::program::args::DenseArgs;
use crate::program::job::Job;
use crate::program::many::every;
use crate::program::open::settings::of_dense;
use crate::program::open::{prior, scene};
use crate::program::progress::Progress;
use crate::refiner::Refiner;
use anyhow::{Result, ensure};

pub(super) fn run(args: &DenseArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    ensure!(
        args.prior.source.prior_depth.is_none(),
        "--prior-depth: is the map of one photograph; give --prior-model, or nothing"
    );
    let output = args.run.output(&args.capture, "-dense");
    every::check_folder(&output)?;
    let prior = prior::open(&args.prior, true)?;
    let refiner = Refiner::new(&prior, of_dense(args)?)?;
    let (scene, plan) = scene::whole(&refiner, &args.camera, &args.capture, &mut progress)?;
    let export = &args.export.export;
    let job = Job { command: "dense", refiner: &refiner, export, truth: None, keep_photographs: false };
    every::run(&job, &scene, &plan, args, &output, &mut progress)
}
