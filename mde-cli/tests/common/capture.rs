//! Photographs of a procedural room with exact depth and poses, and a simulated prior of each.

use mde_cli::mde_prior::{DepthPrior, PriorDepth};
use mde_cli::ndarray::{Array2, Array3, ArrayView3};
use mde_cli::several::{Capture, Photograph};
use mde_eval::capture::Capture as Rendered;
use mde_eval::scene::{CaptureConfig, Room, World};
use mde_eval::simulated::SimulatedPriorConfig;

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

pub(crate) fn rendered_at(room: Room, views: usize, [width, height]: [usize; 2]) -> Rendered {
    let config =
        CaptureConfig { views, prior: SimulatedPriorConfig::disparity(), ..CaptureConfig::default() };
    World::new(room, 0).unwrap().capture("room", &config, width, height).unwrap()
}

pub(crate) fn inputs(rendered: &Rendered, posed: bool) -> (Capture, Known) {
    let photographs = rendered.views.iter().enumerate().map(|(index, known)| Photograph {
        name: format!("photograph {index}"),
        image: known.view.image.clone(),
        mask: known.view.mask.clone(),
        camera: known.view.camera,
        focal_assumed: false,
        pose: posed.then_some(known.view.pose),
    });
    let capture =
        Capture { photographs: photographs.collect(), reference: rendered.reference, points: Vec::new() };
    let known = rendered.views.iter().map(|v| (v.view.image.clone(), v.prior.clone().unwrap())).collect();
    (capture, Known(known))
}
