//! Another scene model in the loop: the depth of the first view as one surface. Any model that is fitted to posed views and
//! renders depth with variance can be used in this way, for example a Gaussian splat.
#![allow(clippy::print_stdout)]

use mde_cli::mde_eval::scene::{Room, room};
use mde_cli::mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
use mde_cli::mde_fusion::BayesFuser;
use mde_cli::mde_nerf::{Error, FieldCallback, FitReport, RadianceField, RenderedView, Result};
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use mde_cli::ndarray::{Array2, Array3};
use mde_cli::{Config, Event, Stages, refine};
use std::ops::ControlFlow;

#[derive(Default)]
struct Surface(Option<PosedView>);

impl RadianceField for Surface {
    fn fit(&mut self, views: &[PosedView], _: &mut dyn FieldCallback) -> Result<FitReport> {
        self.0 = Some(views.first().ok_or(Error::NoPixels)?.clone());
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut dyn FieldCallback) -> Result<RenderedView> {
        let view = self.0.as_ref().ok_or(Error::NotFitted)?;
        let hypothesis = view.hypotheses.first().ok_or(Error::NoRange)?;
        // A standard deviation of 1 % of the depth.
        let depth = hypothesis.clone().map(|mean, _| (mean, (0.01 * mean).powi(2)));
        let depth = reproject(&depth, &view.camera, &view.pose, camera, pose, &ReprojectConfig::default())
            .map_err(Error::external)?;
        let (height, width) = (camera.height, camera.width);
        Ok(RenderedView {
            image: Array3::from_elem((height, width, 3), 0.5),
            depth,
            opacity: Array2::ones((height, width)),
        })
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = room(Room::Study, 0, 160, 120)?;
    let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
    let config = Config::default();
    let fuser = BayesFuser::new(config.fusion.clone())?;
    let mut field =
        |_: usize| -> mde_cli::Result<Box<dyn RadianceField>> { Ok(Box::new(Surface::default())) };
    let stages = Stages { prior: &prior, field: &mut field, fuser: &fuser };
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut go_on)?;
    for iteration in &refined.iterations {
        let fusion = &iteration.fusion;
        println!("a {:.4}, b {:.4}, sigma_o {:.4}", fusion.a, fusion.b, fusion.sigma_o);
    }
    Ok(())
}
