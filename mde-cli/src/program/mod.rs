//! `mde`: refines the monocular depth of a photograph, with a standard deviation per pixel.

mod args;
mod commands;
#[cfg(test)]
mod documented;
mod evaluation;
mod interrupt;
mod job;
mod many;
mod open;
mod progress;
mod provenance;
mod report;
mod store;
mod summary;
mod terminal;
mod workers;

use args::*;
use clap::FromArgMatches;
use job::{Job, Truth};
use open::photographs;
use progress::Progress;
use provenance::{about, command_line, peak_memory, write_json, write_record};
use std::io::{self, Write};
use std::panic::{self, AssertUnwindSafe};
use std::process::ExitCode;
use summary::{intervals, poses_of};
use terminal::{Partial, columns, fault, flags, line_of, message, number, one_line, partial, print, visible};
use workers::{caught, lock, side_by_side};

const FAULT: u8 = 101;
const KEPT: &str = "interrupted; finished work is kept, and the same command resumes it";

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    let matches = args::command().try_get_matches().unwrap_or_else(|error| args::explained(error).exit());
    let cli = args::Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    // Kept, not printed: a panic within a network's runtime becomes an error that names the network.
    panic::set_hook(Box::new(|info| *fault() = info.to_string()));
    interrupt::install();
    let Ok(result) = panic::catch_unwind(AssertUnwindSafe(|| commands::run(&cli.command))) else {
        tell(&format!("error: a fault of the program, please report it: {}", fault()));
        return ExitCode::from(FAULT);
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) if interrupt::requested() => {
            tell(match &cli.command {
                Command::Eval(_) | Command::Ablate(_) | Command::Calibrate(_) => KEPT,
                Command::Refine(one) if photographs::are_many(&one.photographs()) => KEPT,
                Command::Dense(_) => KEPT,
                _ => "interrupted; nothing was written",
            });
            ExitCode::from(interrupt::EXIT_CODE)
        }
        Err(error) => {
            let begin = console::style("error:").for_stderr().red().bold();
            tell(&format!("{begin} {}", visible(&message(&error))));
            if error.is::<Partial>() { ExitCode::from(3) } else { ExitCode::FAILURE }
        }
    }
}

/// One line on stderr.
fn tell(message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = writeln!(io::stderr(), "{line}");
}
