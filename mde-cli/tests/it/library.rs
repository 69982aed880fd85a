//! The loop as a library: settings that take no time, and a procedural room with its priors.

use mde_cli::mde_prior::{DepthPrior, PriorDepth};
use mde_cli::ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use mde_cli::scene::{CameraSource, KnownCamera, Photograph, Scene};
use mde_cli::several::prepared::PreparedScene;
use mde_cli::{Callback, Config, Event, Preset, Refinement, Result, Stages};
use mde_eval::capture::Capture as Rendered;
use mde_eval::scene::{CaptureConfig, Room, World};
use std::ops::ControlFlow;
use std::sync::LazyLock;

pub(crate) const WIDTH: usize = 64;
pub(crate) const HEIGHT: usize = 48;

/// Short iterations. An estimated variance of the prior would be 0 here and leave the prior, whatever the field.
pub(crate) fn tiny(steps: usize, iterations: usize) -> String {
    format!(
        "refinement = {{ iterations = {iterations}, order = 'paper' }}
views.count = 3
novel.count = 2
nerf.field = {{ kind = 'hash', levels = 4, log2-rows = 10, finest = 64, width = 16 }}
nerf.train = {{ steps = {steps}, rays = 128, warm-up = 4, learning-rate = 1e-2 }}
nerf.sampling = {{ coarse = 8, fine = 8 }}
nerf.render = {{ coarse = 8, fine = 8 }}
fusion.prior-variance = 'fixed-relative'
"
    )
}

/// A preset with settings in TOML over it.
pub(crate) fn config(preset: Preset, text: &str) -> Config {
    preset.config().with_text(text, "test").unwrap()
}

/// The simulated prior of each photograph.
pub(crate) struct Known(pub(crate) Vec<(Array3<f32>, PriorDepth)>);

impl DepthPrior for Known {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_cli::mde_prior::Result<PriorDepth> {
        match self.0.iter().find(|(known, _)| known.view() == image) {
            Some((_, depth)) => Ok(depth.clone()),
            // A crop.
            None => {
                let (height, width, _) = image.dim();
                PriorDepth::from_values(Array2::from_elem((height, width), 3.0), self.0[0].1.kind)
            }
        }
    }

    fn accepts_new_images(&self) -> bool {
        true
    }

    fn concurrency(&self) -> usize {
        usize::MAX
    }
}

/// Photographs of a procedural room with exact depth and poses, and a simulated prior of each.
pub(crate) fn rendered(room: Room, views: usize, [width, height]: [usize; 2]) -> Rendered {
    let config = CaptureConfig { views, ..CaptureConfig::default() };
    World::new(room, 0).unwrap().capture("room", &config, width, height).unwrap()
}

/// Width and height of [`STUDY`].
pub(crate) const SIZE: [usize; 2] = [128, 96];
pub(crate) static STUDY: LazyLock<Rendered> = LazyLock::new(|| rendered(Room::Study, 4, SIZE));

pub(crate) fn inputs(rendered: &Rendered, posed: bool) -> (Scene, Known) {
    let photographs = rendered.views.iter().enumerate().map(|(index, known)| Photograph {
        mask: known.view.mask.clone(),
        pose: posed.then_some(known.view.pose),
        ..Photograph::new(
            format!("photograph {index}"),
            known.view.image.clone(),
            KnownCamera { camera: known.view.camera, source: CameraSource::Scene },
        )
    });
    let scene = Scene::several(photographs.collect()).unwrap();
    let known = rendered.views.iter().map(|v| (v.view.image.to_owned(), v.prior.clone().unwrap())).collect();
    (scene, Known(known))
}

/// The reference of several photographs.
pub(crate) fn refine_several(
    scene: &Scene,
    stages: Stages<'_>,
    config: &Config,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    PreparedScene::new(scene, &stages, config, callback)?.refine(0, stages, callback)
}

/// Goes on at every event.
pub(crate) fn go_on(_: &Event) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// `a / b` where both are known.
pub(crate) fn ratios<'a>(a: ArrayView2<'a, f32>, b: &'a Array2<f32>) -> impl Iterator<Item = f64> + 'a {
    let known = a.into_iter().zip(b).filter(|(a, b)| **a > 0.0 && **b > 0.0);
    known.map(|(a, b)| f64::from(a / b))
}
