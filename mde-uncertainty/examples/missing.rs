//! A depth map with a hole, through an inversion to disparity: `cargo run -p mde-uncertainty --example missing`.
#![allow(clippy::print_stdout)]

use mde_uncertainty::{GaussianDepth, ndarray::array};

fn main() -> mde_uncertainty::Result<()> {
    let depth = GaussianDepth::new(array![[2.0, 0.0, 4.0]], array![[0.04, f32::INFINITY, 0.16]])?;
    // First order: Var(1/z) = Var(z) / z^4.
    let disparity = depth.map(|mean, variance| (1.0 / mean, variance / mean.powi(4)));
    println!("disparity {:?}", disparity.mean());
    println!("sigma     {:?}", disparity.sigma());
    println!("support   {:?}", disparity.support());
    Ok(())
}
