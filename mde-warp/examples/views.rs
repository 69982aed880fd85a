//! Warps a 640x480 room with a box and a pole into ten synthetic views, and prints the holes of each.
//!
//! `cargo run --release -p mde-warp --example views`
#![allow(clippy::print_stdout)]

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::ndarray::{Array2, Array3};
use mde_warp::{PinholeCamera, Pose, ViewSampling, WarpConfig, forward_warp, sample_poses};
use std::time::Instant;

/// A floor in front of a wall, a box at the left and a thin pole at the right.
fn depth_at(camera: &PinholeCamera, row: usize, column: usize) -> f32 {
    let below = (row as f64 - camera.cy) / camera.fy;
    let room = if below > 0.0 { (1.2 / below).min(4.0) } else { 4.0 };
    let boxed = (150..300).contains(&row) && (120..260).contains(&column);
    let pole = (60..420).contains(&row) && (450..453).contains(&column);
    (if boxed || pole { room.min(1.8) } else { room }) as f32
}

fn main() -> Result<(), mde_warp::Error> {
    let camera = PinholeCamera::from_fov(60.0, 640, 480)?;
    let mean = Array2::from_shape_fn(camera.dim(), |(row, column)| depth_at(&camera, row, column));
    let depth = GaussianDepth::new(mean.clone(), mean.mapv(|z| (0.02 * z).powi(2)))?;
    let image = Array3::from_shape_fn((480, 640, 3), |(row, column, channel)| {
        let stripe = ((row + 2 * column) / (8 << channel)) % 2;
        0.2 + 0.6 * stripe as f32
    });

    let (origin, config) = (Pose::identity(), WarpConfig::default());
    let scale = median(mean).unwrap_or(1.0);
    println!("view  x [cm]  y [cm]  angle  hidden  outside   time");
    for (index, pose) in sample_poses(&ViewSampling::default(), scale, 1)?.iter().enumerate() {
        let start = Instant::now();
        let warped = forward_warp(image.view(), &depth, &camera, &origin, &camera, pose, &config)?;
        let seconds = start.elapsed().as_secs_f64();
        let centre = pose.inverse().translation.vector * 100.0;
        println!(
            "{index:4}  {:6.2}  {:6.2}  {:4.2}°  {:5.2}%   {:5.2}%  {:3.0} ms",
            centre.x,
            centre.y,
            pose.rotation.angle().to_degrees(),
            100.0 * warped.hole_fraction,
            100.0 * warped.outside_fraction,
            1e3 * seconds,
        );
    }
    Ok(())
}
