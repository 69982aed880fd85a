//! The standard deviation of a hard surface with and without the in-bin variance: `cargo run -p mde-uncertainty --example ray`.
#![allow(clippy::print_stdout)]

use mde_uncertainty::termination::{InBinVariance, moments, weights};

fn main() {
    // An opaque half-space from 2.03 on, in bins of 0.1.
    let extent = [0.1_f64; 40];
    let depth: Vec<f64> = (0..40).map(|i| 0.05 + 0.1 * f64::from(i)).collect();
    let density: Vec<f64> = depth.iter().map(|&t| if t > 2.03 { 80.0 } else { 0.0 }).collect();
    let mut w = [0.0; 40];
    weights(&density, &extent, &mut w);
    for in_bin in [InBinVariance::Midpoint, InBinVariance::Uniform] {
        let end = moments(&w, &depth, &extent, in_bin);
        println!("{in_bin:?}: {:.4} +- {:.4} (surface at 2.03)", end.mean, end.variance.sqrt());
    }
}
