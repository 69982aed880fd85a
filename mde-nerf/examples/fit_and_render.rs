//! Fits a field to one posed view and prints the termination depth of a ray: `cargo run --release -p mde-nerf --example fit_and_render`.
#![allow(clippy::print_stdout)]

use mde_nerf::mde_uncertainty::GaussianDepth;
use mde_nerf::mde_warp::{PinholeCamera, Pose, PosedView};
use mde_nerf::nalgebra::{Translation3, UnitQuaternion};
use mde_nerf::ndarray::{Array2, Array3};
use mde_nerf::{FieldConfig, HashFieldConfig, Nerf, NerfConfig, RadianceField, Silent};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A slanted wall with stripes, and its depth.
    let (height, width) = (48, 64);
    let camera = PinholeCamera::from_fov(60.0, width, height)?;
    let image = Array3::from_shape_fn((height, width, 3), |(y, x, c)| {
        0.5 + 0.4 * (0.3 * x as f32 + 0.2 * y as f32 + c as f32).sin()
    });
    let depth = GaussianDepth::new(
        Array2::from_shape_fn((height, width), |(_, x)| 2.0 + 0.01 * x as f32),
        Array2::from_elem((height, width), 1e-4),
    )?;
    let mask = Array2::from_elem((height, width), true);
    let view = PosedView::new(image, camera, Pose::identity(), mask, vec![depth])?;

    let mut config =
        NerfConfig { field: FieldConfig::Hash(HashFieldConfig::default()), ..NerfConfig::default() };
    config.train.steps = 200;
    config.train.depth_weight = 0.2;
    let mut field = Nerf::new(config, 0)?;
    let report = field.fit(&[view], &mut Silent)?;

    let aside = Pose::from_parts(Translation3::new(0.05, 0.0, 0.0), UnitQuaternion::identity());
    for (name, pose) in [("the view", Pose::identity()), ("5 cm aside", aside)] {
        let rendered = field.render(&camera, &pose, &mut Silent)?;
        let (mean, variance) = rendered.depth.get(height / 2, width / 2).unwrap_or_default();
        println!("{name}: depth {mean:.3} ± {:.3} at the centre", variance.sqrt());
    }
    println!("PSNR {:.1} dB", report.psnr[0]);
    Ok(())
}
