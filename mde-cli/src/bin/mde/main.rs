//! `mde`: refines the monocular depth of a photograph, with a standard deviation per pixel.

mod args;
mod commands;
#[cfg(test)]
mod documented;
mod evaluation;
mod input;
mod output;
mod report;
mod run;
mod terminal;

use crate::run::interrupt;
use clap::Parser;
use std::io::{self, Write};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = args::Cli::parse();
    let result = interrupt::install().map_err(Into::into).and_then(|()| commands::run(&cli.command));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) if interrupt::requested() => {
            let resumable = match &cli.command {
                args::Command::Eval(_) | args::Command::Ablate(_) | args::Command::Calibrate(_) => true,
                args::Command::Refine(refine) => refine.resume,
                _ => false,
            };
            print(match resumable {
                true => "interrupted; finished work is kept, and the same command resumes it",
                false => "interrupted; nothing was written",
            });
            ExitCode::from(interrupt::EXIT_CODE)
        }
        Err(error) => {
            print(&format!("error: {}", message(&error)));
            if error.is::<evaluation::results::Partial>() { ExitCode::from(3) } else { ExitCode::FAILURE }
        }
    }
}

/// The error and its causes, without those that its text contains already.
fn message(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        _ if text.contains(&cause) => text,
        _ => format!("{text}: {cause}"),
    })
}

/// One line on stderr.
fn print(message: &str) {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    let _ = writeln!(io::stderr(), "{line}");
}
