//! Reprojects a slanted plane into a moved camera and back, and prints the loss in pixels, depth and sigma.
//!
//! `cargo run --release -p mde-warp --example there_and_back`
#![allow(clippy::print_stdout)]

use mde_uncertainty::GaussianDepth;
use mde_warp::nalgebra::{UnitQuaternion, Vector3};
use mde_warp::ndarray::Array2;
use mde_warp::{PinholeCamera, Pose, ReprojectConfig, reproject};
use std::time::Instant;

fn main() -> Result<(), mde_warp::Error> {
    let camera = PinholeCamera::from_fov(60.0, 640, 480)?;
    let mean = Array2::from_shape_fn(camera.dim(), |(_, column)| 1.0 / (0.5 - 0.0004 * column as f32));
    let depth = GaussianDepth::new(mean.clone(), Array2::from_elem(camera.dim(), 1e-4))?;
    let turn = UnitQuaternion::from_euler_angles(0.01, -0.02, 0.005);
    let (origin, moved) = (Pose::identity(), Pose::from_parts(Vector3::new(0.05, -0.03, 0.1).into(), turn));

    let config = ReprojectConfig::default();
    let start = Instant::now();
    let there = reproject(&depth, &camera, &origin, &camera, &moved, &config)?;
    let back = reproject(&there, &camera, &moved, &camera, &origin, &config)?;
    let milliseconds = 500.0 * start.elapsed().as_secs_f64();

    let (mut known, mut worst, mut sigma) = (0_usize, 0.0_f32, 0.0_f64);
    for ((row, column), &truth) in mean.indexed_iter() {
        if let Some((mean, variance)) = back.get(row, column) {
            known += 1;
            worst = worst.max((mean / truth - 1.0).abs());
            sigma += f64::from(variance).sqrt();
        }
    }
    println!("pixels back    {:.2} %", 100.0 * known as f64 / mean.len() as f64);
    println!("largest error  {worst:.1e} (relative)");
    println!("mean sigma     {:.3} mm, 10 mm before", 1e3 * sigma / known as f64);
    println!("time           {milliseconds:.0} ms per reprojection");
    Ok(())
}
