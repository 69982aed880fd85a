//! `mde demo`: a procedural room with exact depth, photographed several times or once.

mod several;
mod single;

use crate::program::args::{DemoArgs, UnitName};
use crate::program::open::camera::KnownCamera;
use crate::program::open::opened::{settings, use_threads};
use crate::program::open::size::check_memory;
use crate::program::open::truth::Truth;
use crate::program::store::folder::OutputFolder;
use crate::program::job::Job;
use crate::program::progress::Progress;
use anyhow::Result;
use crate::prior::bound::BoundPrior;
use crate::scene::photograph::Opened;
use crate::prior::origin::{PriorForm, PriorOrigin};
use crate::refiner::plan::refine_bytes;
use crate::several::Capture;
use crate::config::Preset;
use mde_eval::scene::Room;
use mde_eval::score::ScoreConfig;
use mde_prior::{DepthKind, DepthPrior};
use ndarray::{Array2, Array3};
use std::path::Path;

/// The room of every demo.
const ROOM: Room = Room::Study;

/// What a demo refines.
struct Scene {
    image: Array3<f32>,
    camera: KnownCamera,
    truth: Array2<f32>,
    prior: Box<dyn DepthPrior>,
    kind: DepthKind,
    /// Further photographs.
    capture: Option<Capture>,
}

pub(super) fn run(args: &DemoArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output(Path::new("mde"), "-demo"), args.run.force)?;
    let (preset, mut config) = settings(&args.settings, Preset::MultiView)?;
    let [width, height] = args.size;
    check_memory(&args.memory, "--size", (height, width), |pixels| refine_bytes(pixels, &config))?;
    let own_settings = args.settings.config.is_some();
    let scene = match preset {
        Preset::MultiView => several::scene(args.size, &mut config, &mut progress)?,
        _ => single::scene(args.size, own_settings, &mut config, &mut progress)?,
    };
    let origin = PriorOrigin::new(PriorForm::Simulated, scene.kind, "simulated");
    let job = Job {
        command: "demo",
        input: format!("{ROOM}, seed {}", config.seed),
        opened: Opened::new(scene.image, scene.camera),
        prior: BoundPrior::new(&*scene.prior, &origin),
        preset,
        config,
        truth: Some(Truth {
            source: "exact".to_owned(),
            depth: scene.truth,
            config: ScoreConfig::default(),
            brief: true,
        }),
        save_field: false,
        at_once: 1,
        error_bar: args.error_bar.open()?,
        export: args.export.export.clone(),
        capture: scene.capture,
        keep_photographs: true,
        unit: UnitName::Prior,
        known: None,
        same_scale: None,
    };
    job.run(&folder, &mut progress)
}
