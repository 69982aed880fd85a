//! The subcommands.

mod ablate;
mod bench;
mod calibrate;
mod demo;
mod dense;
mod doctor;
mod eval;
mod manual;
mod poses;
mod refine;
mod render;
mod score;
mod warp;

use crate::program::args::Command;
use crate::program::report;
use crate::program::terminal::{line_of, print};
use anyhow::Result;

pub(crate) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Demo(args) => demo::run(args),
        Command::Refine(args) => refine::run(args),
        Command::Dense(args) => dense::run(args),
        Command::Poses(args) => poses::run(args),
        Command::Warp(args) => warp::run(args),
        Command::Render(args) => render::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Score(args) => score::run(args),
        Command::Ablate(args) => ablate::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Config { preset } => print(preset.config().to_toml()?.as_bytes()),
        Command::Bench(args) => bench::run(args),
        Command::Report { folder } => {
            print(format!("wrote {}\n", line_of(&report::write(folder)?)).as_bytes())
        }
        Command::Doctor(args) => doctor::run(args),
        Command::Completions { shell } => manual::completions(*shell),
        Command::Man { command } => manual::page(command.as_deref()),
    }
}
