//! The subcommands.

mod bench;
mod demo;
mod doctor;
mod evaluate;
mod manual;
mod poses;
mod refine;
mod render;
mod score;
mod warp;

use crate::program::{Command, line_of, print, report};
use anyhow::Result;

pub(crate) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Demo(args) => demo::run(args),
        Command::Refine(args) => refine::refine(args),
        Command::Dense(args) => refine::dense(args),
        Command::Poses(args) => poses::run(args),
        Command::Warp(args) => warp::run(args),
        Command::Render(args) => render::run(args),
        Command::Eval(args) => evaluate::eval(args),
        Command::Score(args) => score::run(args),
        Command::Ablate(args) => evaluate::ablate(args),
        Command::Calibrate(args) => evaluate::calibrate(args),
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
