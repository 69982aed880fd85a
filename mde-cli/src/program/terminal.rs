//! Results on a terminal of any width.

use anyhow::{Context, Result};
use mde_eval::table::{Block, Document};
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

/// A document for a terminal of that width; without one, as Markdown. Tables are as wide as their cells.
pub(crate) fn shown(document: &Document, columns: usize) -> String {
    if columns == usize::MAX {
        return document.markdown().trim_end().to_owned();
    }
    let block = |block: &Block| match block {
        Block::Heading(level, text) => wrapped(&format!("{} {text}", "#".repeat(*level)), columns, 2),
        Block::Text(text) => wrapped(text, columns, 2),
        Block::List(lines) => wrapped(&format!("- {}", lines.join("\n- ")), columns, 2),
        Block::Table(table) => table.aligned(),
    };
    document.blocks.iter().map(block).collect::<Vec<_>>().join("\n\n")
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

/// Breaks the lines that are longer than `columns` between words, and indents what follows.
pub(crate) fn wrapped(text: &str, columns: usize, indent: usize) -> String {
    let columns = if columns < 2 * indent { usize::MAX } else { columns };
    let mut lines = Vec::new();
    for line in text.lines() {
        let mut part = String::new();
        for word in line.split_inclusive(' ') {
            let used = part.chars().count();
            if used > indent && used + word.trim_end().chars().count() > columns {
                lines.push(std::mem::replace(&mut part, " ".repeat(indent)));
            }
            part += word;
        }
        lines.push(part);
    }
    lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_and_lose_none() {
        let text = "depth: typical change of 3.2 % per pixel\nshort";
        let broken = wrapped(text, 20, 2);
        assert_eq!(broken, "depth: typical\n  change of 3.2 %\n  per pixel\nshort");
        for (columns, indent) in [(usize::MAX, 2), (12, 9), (0, 2), (1, 0), (60, 2)] {
            let broken = wrapped(text, columns, indent);
            assert!(broken.split_whitespace().eq(text.split_whitespace()), "{columns}: {broken}");
        }
        assert_eq!(
            wrapped("a-word-longer-than-the-line and more", 12, 2),
            "a-word-longer-than-the-line\n  and more"
        );
    }

    #[test]
    fn a_table_is_aligned_and_a_file_gets_markdown() {
        let rows = [["fast", "**1.91** (3.5)", "0.294"], ["unsharp as fast", "2", "0.3"]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        let table = Table::new(1, ["method", "MSE, m² ↓", "AbsRel ↓"], rows);
        let blocks = vec![Block::Text("Mean:".to_owned()), Block::Table(table)];
        let document = Document { blocks };
        assert_eq!(shown(&document, usize::MAX), document.markdown().trim_end());
        let expected = "Mean:\n\n\
                        method            MSE, m² ↓  AbsRel ↓\n\
                        fast             1.91 (3.5)     0.294\n\
                        unsharp as fast           2       0.3";
        assert_eq!(shown(&document, 80), expected);
    }
}
