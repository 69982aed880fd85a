//! Results on a terminal of any width.

use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, Table, Width, presets};
use mde_eval::table::{Block, Cell, Document};
use std::io::{self, IsTerminal};

/// Width of the terminal on stdout; `usize::MAX` where stdout is no terminal.
pub(crate) fn columns() -> usize {
    if io::stdout().is_terminal() { usize::from(console::Term::stdout().size().1) } else { usize::MAX }
}

/// A document for a terminal of that width; without one, as Markdown.
pub(crate) fn shown(document: &Document, columns: usize) -> String {
    if columns == usize::MAX {
        return document.markdown().trim_end().to_owned();
    }
    let block = |block: &Block| match block {
        Block::Heading(level, text) => wrapped(&format!("{} {text}", "#".repeat(*level)), columns, 2),
        Block::Text(text) => wrapped(text, columns, 2),
        Block::List(lines) => {
            let items = lines.iter().map(|line| wrapped(&format!("- {line}"), columns, 2));
            items.collect::<Vec<_>>().join("\n")
        }
        Block::Table(table) => drawn(table, columns),
    };
    document.blocks.iter().map(block).collect::<Vec<_>>().join("\n\n")
}

/// A table in parts that fit into the width; each begins with the first column.
fn drawn(table: &mde_eval::table::Table, columns: usize) -> String {
    let head = table.columns.iter().map(|column| column.head.clone()).collect();
    let rows = table.rows.iter().map(|row| row.iter().map(Cell::plain).collect());
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
    let numbers: Vec<bool> = table.columns.iter().map(|column| column.numeric).collect();
    let widths = longest_words(&rows);
    let (first, mut next) = (widths.first().copied().unwrap_or(0), 1);
    let mut parts = Vec::new();
    loop {
        let mut used = first;
        let fits = |&(index, width): &(usize, &usize)| {
            used += width;
            index == next || used <= columns
        };
        let end = widths.iter().enumerate().skip(next).take_while(fits).last().map_or(next, |(i, _)| i + 1);
        let part: Vec<usize> = std::iter::once(0).chain(next..end).collect();
        parts.push(part_of(&rows, &part, (&widths, &numbers), columns));
        next = end;
        if next >= widths.len() {
            return parts.join("\n\n");
        }
    }
}

/// Length of the longest word of each column, with the spaces beside it.
fn longest_words(rows: &[Vec<String>]) -> Vec<usize> {
    let longest = |cell: &String| cell.split(' ').map(|word| word.chars().count()).max().unwrap_or(0) + 2;
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    (0..count)
        .map(|column| rows.iter().filter_map(|row| row.get(column)).map(longest).max().unwrap_or(0))
        .collect()
}

/// Some columns of a table, none narrower than its longest word; numbers are aligned right.
fn part_of(
    rows: &[Vec<String>],
    part: &[usize],
    (widths, numbers): (&[usize], &[bool]),
    columns: usize,
) -> String {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Dynamic);
    table.set_width(u16::try_from(columns).unwrap_or(u16::MAX));
    let mut content = rows.iter().map(|row| part.iter().map(|&i| row.get(i).cloned().unwrap_or_default()));
    table.set_header(content.next().into_iter().flatten());
    content.for_each(|row| {
        table.add_row(row);
    });
    for (column, &index) in table.column_iter_mut().zip(part) {
        let width = widths.get(index).map_or(0, |&width| u16::try_from(width).unwrap_or(u16::MAX));
        column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(width)));
        if numbers.get(index).is_some_and(|number| *number) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.trim_fmt()
}

/// Words with the spaces after them; a number and its unit are one.
fn words(line: &str) -> impl Iterator<Item = &str> {
    let is_number =
        |word: &str| word.trim_end_matches(' ').trim_start_matches(['-', '+', '(']).parse::<f64>().is_ok();
    let mut rest = line;
    std::iter::from_fn(move || {
        let next = |from: usize| rest[from..].find(' ').map_or(rest.len(), |at| from + at + 1);
        let mut end = next(0);
        if end < rest.len() && is_number(&rest[..end]) {
            end = next(end);
        }
        let (word, after) = rest.split_at(end);
        rest = after;
        (!word.is_empty()).then_some(word)
    })
}

/// Breaks the lines that are longer than `columns` between words, and indents what follows.
pub(crate) fn wrapped(text: &str, columns: usize, indent: usize) -> String {
    let broken = |line: &str| {
        if line.chars().count() <= columns || columns < 2 * indent {
            return line.to_owned();
        }
        let mut lines = vec![String::new()];
        for word in words(line) {
            let used = lines.last().map_or(0, |last| last.chars().count());
            if used > indent && used + word.trim_end().chars().count() > columns {
                lines.push(" ".repeat(indent));
            }
            if let Some(last) = lines.last_mut() {
                *last += word;
            }
        }
        lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
    };
    // Text that fits is returned unchanged.
    if text.lines().all(|line| line.chars().count() <= columns) {
        return text.to_owned();
    }
    text.lines().map(broken).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_and_lose_none() {
        let text = "depth: typical change of 3.2 % per pixel\nshort";
        let broken = wrapped(text, 20, 2);
        assert_eq!(broken, "depth: typical\n  change of 3.2 %\n  per pixel\nshort");
        // A number stays with its unit.
        assert_eq!(
            wrapped("depth: typical change of 3.2 % per pixel", 28, 2),
            "depth: typical change of\n  3.2 % per pixel"
        );
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
    fn a_table_fits_and_a_file_gets_markdown() {
        use mde_eval::table::{Column, Table};
        let columns = vec![Column::text("method"), Column::number("MSE, m² ↓"), Column::number("AbsRel ↓")];
        let row = |cells: [&str; 3]| cells.map(Cell::new).to_vec();
        let rows = vec![row(["unsharp as sharp as fast", "1.91 (3.5)", "0.294"])];
        let blocks = vec![Block::Text("Mean:".to_owned()), Block::Table(Table { columns, rows })];
        let document = Document { blocks };
        assert_eq!(shown(&document, usize::MAX), document.markdown().trim_end());
        for columns in [30, 44, 80, 200] {
            let drawn = shown(&document, columns);
            assert!(drawn.lines().all(|line| line.chars().count() <= columns), "{columns}:\n{drawn}");
            let has = |word: &str| drawn.contains(word);
            assert!(["method", "unsharp", "1.91", "(3.5)", "0.294", "Mean:"].into_iter().all(has));
            assert!(!drawn.contains("---"), "{drawn}");
        }
    }
}
