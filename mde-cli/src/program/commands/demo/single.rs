//! One photograph, with a depth map as its prior.

use crate::program::commands::demo::{ROOM, Scene};
use crate::program::open::camera::{CameraSource, KnownCamera};
use crate::program::progress::Progress;
use anyhow::Result;
use crate::config::Config;
use mde_eval::scene::room;
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};

pub(super) fn scene(
    [width, height]: [usize; 2],
    own_settings: bool,
    config: &mut Config,
    progress: &mut Progress,
) -> Result<Scene> {
    if !own_settings {
        config.nerf.train.steps = steps(config.nerf.train.steps, width * height);
    }
    progress.step(&format!("a {ROOM} of {width}x{height} pixels"));
    let scene = room(ROOM, config.seed, width, height)?;
    let faults = SimulatedPriorConfig { seed: config.seed, ..SimulatedPriorConfig::disparity() };
    let prior = SimulatedPrior::new(&scene.depth, &faults)?;
    Ok(Scene {
        image: scene.image,
        camera: KnownCamera { camera: scene.camera, source: CameraSource::Scene },
        truth: scene.depth,
        prior: Box::new(prior),
        kind: faults.kind,
        capture: None,
    })
}

/// The steps of a preset are for 640x480; smaller rooms get fewer in proportion.
fn steps(preset: usize, pixels: usize) -> usize {
    let scaled = preset as f64 * pixels as f64 / (640.0 * 480.0);
    (scaled as usize).clamp(preset.min(500), preset)
}
