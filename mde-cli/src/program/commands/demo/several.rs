//! Several photographs without poses, with a simulated network as the prior of each.

use super::{Demo, ROOM};
use crate::config::Config;
use crate::program::progress::Progress;
use crate::scene::camera::{CameraSource, KnownCamera};
use crate::scene::{Photograph, Scene};
use anyhow::Result;
use mde_eval::capture::CapturedView;
use mde_eval::scene::{CaptureConfig, World};
use mde_eval::simulated::{SimulatedModel, SimulatedModelConfig};
use mde_prior::DepthKind;

/// Photographs that are refined with.
const USED: usize = 5;
/// One more, which only the report shows beside what the field renders.
const WITHHELD: usize = 1;
pub(super) const VIEWS: usize = USED + WITHHELD;
/// The first further photograph is brighter or darker by this factor.
const GAIN: f64 = 0.2;

pub(super) fn demo(
    [width, height]: [usize; 2],
    config: &mut Config,
    progress: &mut Progress,
) -> Result<Demo> {
    config.multi_view.max_views = config.multi_view.max_views.min(USED);
    progress.step(&format!("{VIEWS} photographs of a {ROOM}, {width}x{height} pixels"));
    let world = World::new(ROOM, config.seed)?;
    let taken = CaptureConfig { views: VIEWS, gain: GAIN, seed: config.seed, ..CaptureConfig::default() };
    let mut rendered = world.capture(ROOM.name(), &taken, width, height)?;
    for known in &mut rendered.views {
        // As in the files, from which a refinement can be repeated.
        known.view.image.mapv_inplace(|v| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0);
    }
    let prior = SimulatedModel::of_capture(&world, &rendered, &network(config.seed))?;
    let truth = rendered.truth;
    let photograph = |(index, known): (usize, CapturedView)| {
        let camera = KnownCamera { camera: known.view.camera, source: CameraSource::Scene };
        Photograph {
            mask: known.view.mask,
            ..Photograph::new(format!("{index}.png"), known.view.image, camera)
        }
    };
    let photographs = rendered.views.into_iter().enumerate().map(photograph).collect();
    Ok(Demo {
        scene: Scene::several(photographs, 0)?,
        truth,
        prior: Box::new(prior),
        kind: DepthKind::Metric,
    })
}

/// A network as small as FastDepth. Measured on these rooms, its AbsRel is about .12 and its D3R of random pairs about .4; FastDepth has
/// .17 and .34 to .49 on captures of real rooms.
fn network(seed: u64) -> SimulatedModelConfig {
    SimulatedModelConfig {
        side: 64,
        lost_cells: 4.0,
        lost_width: 0.02,
        shared_error: 0.1,
        seed,
        ..SimulatedModelConfig::default()
    }
}
