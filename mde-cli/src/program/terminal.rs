//! What the user reads: errors in one line with arguments as flags, results on a terminal of any width.

use crate::error::{named, text};
use crate::program::lock;
use anyhow::{Context, Result};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard};

/// Where the last panic began, and its message.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// A part of the results is missing; the rest is written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Partial {
    /// Some photographs, scenes or methods failed.
    #[error("{failed} of the runs failed ({first}); the others are in {folder}")]
    Runs { failed: usize, first: String, folder: String },
    /// No photograph was of use to another.
    #[error("{reason}; the depth in {folder} is that of a photograph alone")]
    Alone { reason: String, folder: String },
}

/// The error of a run in whose `folder` some results are missing; none where nothing failed.
pub(crate) fn partial(failed: usize, first: Option<String>, folder: &Path) -> Result<()> {
    let folder = folder.display().to_string();
    first.map_or(Ok(()), |first| Err(Partial::Runs { failed, first, folder }.into()))
}

pub(crate) fn fault() -> MutexGuard<'static, String> {
    lock(&PANIC)
}

/// The error and its causes, without those that its text contains already.
pub(crate) fn message(error: &anyhow::Error) -> String {
    flags(&text(error.as_ref()))
}

/// A text of the library with the arguments that it names in braces as flags.
pub(crate) fn flags(text: &str) -> String {
    named(text, |argument| match argument {
        "keep-field" => "--export field".to_owned(),
        argument => format!("--{argument}"),
    })
}

/// Writes to stdout; a closed pipe is no error.
pub(crate) fn print(text: &[u8]) -> Result<()> {
    match io::stdout().lock().write_all(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("stdout"),
        _ => Ok(()),
    }
}

/// Width of the terminal on stdout; `usize::MAX` where stdout is no terminal.
pub(crate) fn columns() -> usize {
    if io::stdout().is_terminal() { usize::from(console::Term::stdout().size().1) } else { usize::MAX }
}

/// A text without control characters but for the ends of its lines: names of files may hold any.
pub(crate) fn visible(text: &str) -> String {
    let shown = |c: char| match c.is_control() && c != '\n' {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    };
    text.chars().map(shown).collect()
}

/// The same in one line.
pub(crate) fn one_line(text: &str) -> String {
    visible(text).replace('\n', "\\n")
}

pub(crate) fn line_of(path: &Path) -> String {
    one_line(&path.display().to_string())
}

/// A number with so many digits behind the point, or a dash.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}
