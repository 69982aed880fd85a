//! A soft prior and one sharp view of a step, fused: `cargo run -p mde-fusion --example fuse_two_maps`.
#![allow(clippy::print_stdout)]

use mde_fusion::{BayesFuser, Fuser, FusionConfig, GaussianDepth, Prior, Result, ndarray::Array2};

fn main() -> Result<()> {
    let prior = Prior::new(Array2::from_shape_fn((6, 8), |(_, x)| 2.0 + 0.25 * x as f32))?;
    let step = Array2::from_shape_fn((6, 8), |(_, x)| if x < 4 { 2.4 } else { 3.4 });
    let view = GaussianDepth::new(step, Array2::from_elem((6, 8), 1e-4))?;
    let fused = BayesFuser::new(FusionConfig::paper())?.fuse(&prior, &[view])?;
    println!("prior {:.2}", prior.mean().row(0));
    println!("fused {:.2}", fused.depth.mean().row(0));
    println!("sigma {:.3}", fused.depth.sigma().row(0));
    println!("a {:.3}, b {:.3}, sigma_o {:.3}", fused.report.a, fused.report.b, fused.report.sigma_o);
    Ok(())
}
