//! `mde demo`: a procedural room with exact depth, photographed several times or once.

use crate::config::{Config, Preset};
use crate::prior::{OpenPrior, PriorForm, PriorOrigin};
use crate::program::open::all_settings;
use crate::program::store::OutputFolder;
use crate::program::{DemoArgs, Job, Progress, Truth};
use crate::refiner::Refiner;
use crate::scene::{CameraSource, KnownCamera, Photograph, Scene};
use anyhow::Result;
use mde_eval::capture::CapturedView;
use mde_eval::scene::{CaptureConfig, Room, World, room};
use mde_eval::simulated::{SimulatedModel, SimulatedModelConfig, SimulatedPriorConfig, simulated_prior};
use mde_prior::{DepthKind, DepthPrior, FilePrior};
use ndarray::Array2;
use std::path::Path;

const ROOM: Room = Room::Office;
const USED: usize = 5;
/// With one more, which only the report shows beside what the field renders.
const VIEWS: usize = USED + 1;
/// The first further photograph is brighter or darker by this factor.
const GAIN: f64 = 0.2;

/// What a demo refines: a scene, the exact depth of its reference, the prior.
type Demo = (Scene, Array2<f32>, OpenPrior<'static>);

fn simulated(prior: impl DepthPrior + Send + 'static, kind: DepthKind) -> OpenPrior<'static> {
    OpenPrior::given(Box::new(prior), PriorOrigin::new(PriorForm::Simulated, kind, "simulated"))
}

pub(super) fn run(args: &DemoArgs) -> Result<()> {
    let mut progress = Progress::start(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(Path::new("mde"), "-demo"), args.run.force)?;
    let mut settings = all_settings(&args.settings, &args.results, &args.memory, Preset::MultiView)?;
    settings.sizes.megapixels = f64::INFINITY;
    let several = settings.preset == Preset::MultiView;
    let [width, height] = args.size;
    // Rendering takes much memory already.
    let (nothing, count) = (OpenPrior::nothing(), if several { VIEWS } else { 1 });
    Refiner::new(&nothing, settings.clone())?.plan("--size", (height, width), count)?;
    let config = &mut settings.config;
    let (scene, truth, prior) = match several {
        true => photographs(args.size, config, &mut progress)?,
        false => {
            if args.settings.preset.config.is_empty() {
                // The steps of a preset are for 640x480; smaller rooms get fewer in proportion.
                let steps = &mut config.nerf.train.steps;
                let scaled = *steps as f64 * (width * height) as f64 / (640.0 * 480.0);
                *steps = (scaled as usize).clamp(500.min(*steps), *steps);
            }
            photograph(args.size, config.seed, &mut progress)?
        }
    };
    let input = format!("{ROOM}, seed {}", settings.config.seed);
    let refiner = Refiner::new(&prior, settings)?;
    let plan = refiner.plan("--size", (height, width), scene.photographs.len())?;
    let job = Job {
        command: "demo",
        refiner: &refiner,
        export: &args.results.export,
        truth: Some(Truth { source: "exact".to_owned(), depth: truth }),
        keep_photographs: true,
    };
    job.run(&scene, &plan, &input, &folder, &mut progress)?;
    Ok(())
}

/// One photograph, with a depth map as its prior.
fn photograph([width, height]: [usize; 2], seed: u64, progress: &mut Progress) -> Result<Demo> {
    progress.step(&format!("a {ROOM} of {width}x{height} pixels"));
    let room = room(ROOM, seed, width, height)?;
    let faults = SimulatedPriorConfig { seed, ..SimulatedPriorConfig::disparity() };
    let prior = FilePrior::of_map("simulated", simulated_prior(&room.depth, &faults)?);
    let camera = KnownCamera { camera: room.camera, source: CameraSource::Scene };
    let scene = Scene::one(Photograph::new("0.png", room.image, camera));
    Ok((scene, room.depth, simulated(prior, faults.kind)))
}

/// Several photographs without poses, with a simulated network as the prior of each.
fn photographs([width, height]: [usize; 2], config: &mut Config, progress: &mut Progress) -> Result<Demo> {
    config.multi_view.max_views = config.multi_view.max_views.min(USED);
    progress.step(&format!("{VIEWS} photographs of a {ROOM}, {width}x{height} pixels"));
    let world = World::new(ROOM, config.seed)?;
    let taken = CaptureConfig { views: VIEWS, gain: GAIN, seed: config.seed, ..CaptureConfig::default() };
    let mut rendered = world.capture(&ROOM.to_string(), &taken, width, height)?;
    for known in &mut rendered.views {
        // As in the files, from which a refinement can be repeated.
        known.view.image.mapv_inplace(|v| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0);
    }
    // As small as FastDepth. Measured on these rooms, its AbsRel is about .12 and its D3R of random pairs about .4; FastDepth has .17 and
    // .34 to .49 on captures of real rooms.
    let network = SimulatedModelConfig {
        side: 64,
        lost_cells: 4.0,
        lost_width: 0.02,
        shared_error: 0.1,
        seed: config.seed,
        ..SimulatedModelConfig::default()
    };
    let prior = SimulatedModel::of_capture(&world, &rendered, &network)?;
    let photograph = |(index, CapturedView { view, .. }): (usize, CapturedView)| {
        let camera = KnownCamera { camera: view.camera, source: CameraSource::Scene };
        Photograph { mask: view.mask, ..Photograph::new(format!("{index}.png"), view.image, camera) }
    };
    let scene = Scene::several(rendered.views.into_iter().enumerate().map(photograph).collect())?;
    Ok((scene, rendered.truth, simulated(prior, DepthKind::Metric)))
}
