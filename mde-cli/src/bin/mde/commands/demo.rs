use crate::args::{DemoArgs, UnitName};
use crate::input::camera::{CameraSource, KnownCamera};
use crate::input::opened::{settings, use_threads};
use crate::input::prior::{NamedPrior, PriorOrigin};
use crate::input::size::check_memory;
use crate::input::truth::Truth;
use crate::output::folder::OutputFolder;
use crate::output::recording;
use crate::run::error_bar::ErrorBar;
use crate::run::job::Job;
use crate::run::progress::Progress;
use anyhow::Result;
use mde_cli::Preset;
use mde_cli::memory::refine_bytes;
use mde_eval::scene::{Room, room};
use mde_eval::score::ScoreConfig;
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};

pub(super) fn run(args: &DemoArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output, args.run.force)?;
    let recording = recording::open(&args.export, args.run.force)?;
    let (preset, mut config) = settings(&args.settings, Preset::Default)?;
    let [width, height] = args.size;
    check_memory(&args.memory, "--size", (height, width), |pixels| refine_bytes(pixels, &config))?;
    if args.settings.config.is_none() {
        config.nerf.train.steps = steps(config.nerf.train.steps, width * height);
    }
    progress.step(&format!("a {} of {width}x{height} pixels", Room::Study));
    let scene = room(Room::Study, config.seed, width, height)?;
    let faults = SimulatedPriorConfig { seed: config.seed, ..SimulatedPriorConfig::disparity() };
    let prior = SimulatedPrior::new(&scene.depth, &faults)?;
    let origin =
        PriorOrigin { kind: faults.kind, source: "simulated".to_owned(), model: None, model_hash: None };
    let job = Job {
        command: "demo",
        input: format!("{}, seed {}", Room::Study, config.seed),
        image: scene.image,
        camera: KnownCamera { camera: scene.camera, source: CameraSource::Scene },
        prior: NamedPrior { prior: Box::new(prior), origin },
        preset,
        config,
        truth: Some(Truth { source: "exact".to_owned(), depth: scene.depth, config: ScoreConfig::default() }),
        save_field: false,
        checkpoints: None,
        error_bar: ErrorBar::open(&args.error_bar)?,
        export: args.export.export.clone(),
        recording,
        capture: None,
        unit: UnitName::Prior,
    };
    job.run(&folder, &mut progress)
}

/// The steps of a preset are for 640x480; smaller rooms get fewer in proportion.
fn steps(preset: usize, pixels: usize) -> usize {
    let scaled = preset as f64 * pixels as f64 / (640.0 * 480.0);
    (scaled as usize).clamp(preset.min(500), preset)
}
