//! `mde demo`: a procedural room with exact depth, photographed several times or once.

mod several;
mod single;

use crate::config::Preset;
use crate::prior::OpenPrior;
use crate::prior::origin::{PriorForm, PriorOrigin};
use crate::program::args::DemoArgs;
use crate::program::job::Job;
use crate::program::open::settings::{all_settings, use_threads};
use crate::program::open::truth::Truth;
use crate::program::progress::Progress;
use crate::program::store::folder::OutputFolder;
use crate::refiner::{Refiner, Settings};
use crate::scene::Scene;
use anyhow::Result;
use mde_eval::scene::Room;
use mde_eval::score::ScoreConfig;
use mde_prior::{DepthKind, DepthPrior, PriorDepth};
use ndarray::{Array2, ArrayView3};
use std::path::Path;

/// The room of every demo.
const ROOM: Room = Room::Study;

/// What a demo refines.
struct Demo {
    scene: Scene,
    truth: Array2<f32>,
    prior: Box<dyn DepthPrior + Send>,
    kind: DepthKind,
}

/// Stands for the prior of rooms that are not rendered yet.
struct NotRendered;

impl DepthPrior for NotRendered {
    fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        Err(mde_prior::Error::Input("the room is not rendered yet".to_owned()))
    }
}

/// The size, if so many photographs of it fit in the memory: rendering them takes much already.
fn fitting(settings: &Settings, [width, height]: [usize; 2], photographs: usize) -> Result<[usize; 2]> {
    let origin = PriorOrigin::new(PriorForm::Simulated, DepthKind::Metric, "simulated");
    let prior = OpenPrior::given(Box::new(NotRendered), origin);
    Refiner::new(&prior, settings.clone())?.plan("--size", (height, width), photographs)?;
    Ok([width, height])
}

pub(super) fn run(args: &DemoArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(Path::new("mde"), "-demo"), args.run.force)?;
    let mut settings = all_settings(&args.settings, &args.error_bar, &args.memory, Preset::MultiView)?;
    settings.sizes.megapixels = f64::INFINITY;
    let own_settings = !args.settings.preset.config.is_empty();
    let Demo { scene, truth, prior, kind } = match settings.preset {
        Preset::MultiView => several::demo(
            fitting(&settings, args.size, several::VIEWS)?,
            &mut settings.config,
            &mut progress,
        )?,
        _ => single::demo(
            fitting(&settings, args.size, 1)?,
            own_settings,
            &mut settings.config,
            &mut progress,
        )?,
    };
    let prior = OpenPrior::given(prior, PriorOrigin::new(PriorForm::Simulated, kind, "simulated"));
    let input = format!("{ROOM}, seed {}", settings.config.seed);
    let refiner = Refiner::new(&prior, settings)?;
    let [width, height] = args.size;
    let plan = refiner.plan("--size", (height, width), scene.photographs.len())?;
    let exact =
        Truth { source: "exact".to_owned(), depth: truth, config: ScoreConfig::default(), brief: true };
    let job = Job {
        command: "demo",
        refiner: &refiner,
        export: &args.export.export,
        truth: Some(exact),
        keep_photographs: true,
    };
    job.run(&scene, &plan, &input, &folder, &mut progress)
}
