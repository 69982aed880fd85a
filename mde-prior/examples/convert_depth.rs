//! Converts a depth file: `cargo run --example convert_depth -- depth.png depth.npy`.
#![allow(clippy::print_stdout)]

use std::path::PathBuf;

use mde_prior::format::{ReadOptions, WriteOptions, read_depth, write_depth};
use mde_prior::ndarray::Array2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let scratch = tempfile::tempdir()?;
    let (from, to): (PathBuf, PathBuf) = match arguments.as_slice() {
        [from, to] => (from.into(), to.into()),
        _ => {
            println!("usage: convert_depth FROM TO; here is a ramp, from PFM to PNG");
            let from = scratch.path().join("ramp.pfm");
            let ramp = Array2::from_shape_fn((48, 64), |(y, x)| 1.0 + 0.05 * (x + y) as f32);
            write_depth(&from, ramp.view(), &WriteOptions::default())?;
            (from, scratch.path().join("ramp.png"))
        }
    };
    let depth = read_depth(&from, &ReadOptions::default())?;
    write_depth(&to, depth.view(), &WriteOptions::default())?;
    let known = depth.iter().filter(|&&z| z > 0.0).count();
    println!(
        "{}: {}x{}, {known} of {} pixels known",
        to.display(),
        depth.ncols(),
        depth.nrows(),
        depth.len()
    );
    Ok(())
}
