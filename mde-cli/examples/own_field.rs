//! Another scene model in the loop: one surface, the depth of the first view. Any model that is fitted to posed views and renders
//! depth with a variance can take its place, such as Gaussian splatting.
#![allow(clippy::print_stdout)]

use mde_cli::mde_nerf::{Error, FieldCallback, FitReport, RadianceField, RenderedView, Result};
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use mde_cli::ndarray::{Array2, Array3};
use mde_cli::{Config, Event, Stages, refine};
use mde_eval::scene::{Room, room};
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
use std::ops::ControlFlow;

#[derive(Default)]
struct Surface(Option<PosedView>);

impl RadianceField for Surface {
    fn fit(&mut self, views: &[PosedView], _: &mut dyn FieldCallback) -> Result<FitReport> {
        self.0 = views.first().cloned();
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut dyn FieldCallback) -> Result<RenderedView> {
        let view = self.0.as_ref().ok_or(Error::NotFitted)?;
        let depth = view.hypotheses.first().ok_or(Error::NoRange)?;
        // A standard deviation of 1 % of the depth.
        let depth = depth.clone().map(|mean, _| (mean, (0.01 * mean).powi(2)));
        let seen = reproject(&depth, &view.camera, &view.pose, camera, pose, &ReprojectConfig::default())
            .map_err(|error| Error::External(error.into()))?;
        let size = (camera.height, camera.width);
        Ok(RenderedView {
            image: Array3::from_elem((size.0, size.1, 3), 0.5),
            depth: seen,
            opacity: Array2::ones(size),
            in_bin: None,
        })
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = room(Room::Study, 0, 160, 120)?;
    let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
    let config = Config::default();
    let stages = Stages::new(&prior).with_field(|_| Ok(Box::new(Surface::default())));
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut go_on)?;
    for iteration in &refined.iterations {
        let fusion = &iteration.fusion;
        println!("a {:.4}, b {:.4}, sigma_o {:.4}", fusion.a, fusion.b, fusion.sigma_o);
    }
    Ok(())
}
