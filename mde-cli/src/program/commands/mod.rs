//! The subcommands.

mod bench;
mod demo;
mod doctor;
mod evaluate;
mod poses;
mod refine;
mod render;
mod score;
mod warp;

use crate::program::{Command, args, line_of, print, report};
use anyhow::{Context, Result};
use clap_mangen::Man;

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
        Command::Completions { shell } => {
            let mut text = Vec::new();
            clap_complete::generate(*shell, &mut args::command(), "mde", &mut text);
            print(&text)
        }
        Command::Man { command } => page(command.as_deref()),
    }
}

/// A manual page, of the program or of a command.
fn page(name: Option<&str>) -> Result<()> {
    let mut program = args::command();
    // Gives the subcommands their whole names.
    program.build();
    let page = match name {
        None => program,
        Some(name) => {
            let found = program.find_subcommand(name).filter(|found| found.get_name() != "help").cloned();
            let names: Vec<_> = program.get_subcommands().map(|c| c.get_name().to_owned()).collect();
            let found = found
                .with_context(|| format!("{name}: no such command; give one of {}", names.join(", ")))?;
            let name = format!("mde-{}", found.get_name());
            found.display_name(name)
        }
    };
    let mut text = Vec::new();
    let source = concat!("mde ", env!("CARGO_PKG_VERSION"));
    Man::new(page).source(source).render(&mut text).context("the manual page can't be made")?;
    print(&text)
}
