//! `mde`: refines the monocular depth of a photograph, with a standard deviation per pixel.

use std::process::ExitCode;

fn main() -> ExitCode {
    mde_cli::program::main()
}
