//! Renders a room to `ROOM.png` and `ROOM-depth.png` in the folder given, makes a soft prior of its depth, and scores it.
//!
//! `cargo run --release -p mde-eval --example score_room -- [folder] [room] [seed]`
#![allow(clippy::print_stdout)]

use mde_eval::align::AlignmentRule;
use mde_eval::mde_prior::photo::write_image;
use mde_eval::ndarray::{Array2, Array3};
use mde_eval::scene::{Room, room};
use mde_eval::score::{ScoreConfig, Subject, score};
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().map_or_else(std::env::temp_dir, PathBuf::from);
    let kind: Room = arguments.next().as_deref().unwrap_or("study").parse()?;
    let seed = arguments.next().as_deref().unwrap_or("0").parse()?;

    let scene = room(kind, seed, 640, 480)?;
    write_image(folder.join(format!("{kind}.png")), scene.image.view())?;
    write_image(folder.join(format!("{kind}-depth.png")), shown(&scene.depth).view())?;

    let prior = SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default())?;
    let prediction = &prior.prediction().map;
    write_image(folder.join(format!("{kind}-prior.png")), shown(prediction).view())?;
    for alignment in [AlignmentRule::Median, AlignmentRule::LeastSquaresDisparity] {
        let config = ScoreConfig { alignment, ..ScoreConfig::default() };
        let scores = score(&Subject::new(prediction.view(), scene.depth.view()), &config)?.depth;
        println!(
            "{alignment}: RMSE {:.3} m, AbsRel {:.3}, boundary F1 {:.3}",
            scores.rmse, scores.abs_rel, scores.boundary_f1
        );
        for edges in &scores.edges {
            println!("  {} {:.3}, F1max {:.3}", edges.name, edges.f1, edges.f1_max.unwrap_or(0.0));
        }
    }
    println!("pictures are in {}", folder.display());
    Ok(())
}

/// Near is bright: the root of the disparity over its largest value.
fn shown(depth: &Array2<f32>) -> Array3<f32> {
    let nearest = depth.iter().copied().filter(|&z| z > 0.0).fold(f32::INFINITY, f32::min);
    let (height, width) = depth.dim();
    Array3::from_shape_fn((height, width, 3), |(y, x, _)| {
        let z = depth[(y, x)];
        if z > 0.0 { (nearest / z).sqrt() } else { 0.0 }
    })
}
