//! One photograph, with a depth map as its prior.

use super::{Demo, ROOM};
use crate::config::Config;
use crate::program::progress::Progress;
use crate::scene::camera::{CameraSource, KnownCamera};
use crate::scene::{Photograph, Scene};
use anyhow::Result;
use mde_eval::scene::room;
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};

pub(super) fn demo(
    [width, height]: [usize; 2],
    own_settings: bool,
    config: &mut Config,
    progress: &mut Progress,
) -> Result<Demo> {
    if !own_settings {
        config.nerf.train.steps = steps(config.nerf.train.steps, width * height);
    }
    progress.step(&format!("a {ROOM} of {width}x{height} pixels"));
    let room = room(ROOM, config.seed, width, height)?;
    let faults = SimulatedPriorConfig { seed: config.seed, ..SimulatedPriorConfig::disparity() };
    let prior = SimulatedPrior::new(&room.depth, &faults)?;
    let camera = KnownCamera { camera: room.camera, source: CameraSource::Scene };
    let scene = Scene::one(Photograph::new("0.png", room.image, camera));
    Ok(Demo { scene, truth: room.depth, prior: Box::new(prior), kind: faults.kind })
}

/// The steps of a preset are for 640x480; smaller rooms get fewer in proportion.
fn steps(preset: usize, pixels: usize) -> usize {
    let scaled = preset as f64 * pixels as f64 / (640.0 * 480.0);
    (scaled as usize).clamp(preset.min(500), preset)
}
