//! Results on a terminal of any width.

use anyhow::{Context, Result};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;

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

/// A path in a line.
pub(crate) fn line_of(path: &Path) -> String {
    one_line(&path.display().to_string())
}
