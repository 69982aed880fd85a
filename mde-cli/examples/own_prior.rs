//! Another monocular depth in the loop: a floor that runs away from the camera, refined by a short run.
#![allow(clippy::print_stdout)]

use mde_cli::mde_prior::{DepthKind, DepthPrior, PriorDepth, Result};
use mde_cli::ndarray::{Array2, ArrayView3};
use mde_cli::{Config, Event, Preset, Stages, refine};
use mde_eval::scene::{Room, room};
use std::ops::ControlFlow;

/// The lower in the picture, the nearer.
struct Floor;

impl DepthPrior for Floor {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let disparity = Array2::from_shape_fn((height, width), |(row, _)| row as f32);
        PriorDepth::from_values(disparity, DepthKind::AffineDisparity)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = room(Room::Study, 0, 160, 120)?;
    let config = Config::with_overrides(Preset::Paper, "nerf.train.steps = 200", "example")?;
    let stages = Stages::new(&Floor);
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut go_on)?;
    let report = &refined.iterations[0];
    println!(
        "PSNR of the photograph {:.1} dB, holes {:.1} %",
        report.fit.psnr[0],
        100.0 * report.warp.mean_hole_fraction
    );
    println!(
        "sigma of the prior {:.3}, weight of the views {:.2}",
        report.fusion.sigma_o, report.fusion.nerf_weight
    );
    Ok(())
}
