//! Results on a terminal of any width.

use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, Table, Width, presets};
use std::io::{self, IsTerminal};

/// Columns of the terminal that results are written to; elsewhere lines are as long as they are.
pub(crate) fn columns() -> usize {
    if io::stdout().is_terminal() { usize::from(console::Term::stdout().size().1) } else { usize::MAX }
}

/// Text whose lines and Markdown tables fit into so many columns; for what is no terminal, as it is.
pub(crate) fn fitted(text: &str, columns: usize) -> String {
    if columns == usize::MAX {
        return text.to_owned();
    }
    let mut fitted = Vec::new();
    let mut lines = text.split('\n').peekable();
    while let Some(line) = lines.next() {
        if !line.starts_with('|') {
            fitted.push(wrapped(line, columns, 2));
            continue;
        }
        let mut rows = vec![line];
        rows.extend(std::iter::from_fn(|| lines.next_if(|line| line.starts_with('|'))));
        fitted.push(table(&rows, columns));
    }
    fitted.join("\n")
}

/// A Markdown table, drawn: where it is too wide for its words, in parts that each begin with the first column.
fn table(lines: &[&str], columns: usize) -> String {
    let cells = |line: &str| -> Vec<String> {
        line.trim().trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
    };
    let (rules, rows): (Vec<&str>, Vec<&str>) =
        lines.iter().partition(|line| line.chars().all(|c| "|:- ".contains(c)));
    let rows: Vec<_> = rows.into_iter().map(cells).collect();
    let numbers: Vec<_> = rules.into_iter().flat_map(cells).map(|cell| cell.ends_with(':')).collect();
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
        parts.push(drawn(&rows, &part, (&widths, &numbers), columns));
        next = end;
        if next >= widths.len() {
            return parts.join("\n\n");
        }
    }
}

/// The longest word of each column, with the spaces beside it.
fn longest_words(rows: &[Vec<String>]) -> Vec<usize> {
    let longest = |cell: &String| cell.split(' ').map(|word| word.chars().count()).max().unwrap_or(0) + 2;
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    (0..count)
        .map(|column| rows.iter().filter_map(|row| row.get(column)).map(longest).max().unwrap_or(0))
        .collect()
}

/// Some columns of a table, none narrower than its width; those of numbers are aligned right.
fn drawn(
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

/// Breaks the lines that are longer than `columns` between words, and indents what follows.
pub(crate) fn wrapped(text: &str, columns: usize, indent: usize) -> String {
    let broken = |line: &str| {
        if line.chars().count() <= columns || columns < 2 * indent {
            return line.to_owned();
        }
        let mut lines = vec![String::new()];
        for word in line.split_inclusive(' ') {
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
    // What needs no breaking stays as it is to the last byte.
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
        let text = "depth moved by 3.2 % at the median pixel\nshort";
        let broken = wrapped(text, 20, 2);
        assert_eq!(broken, "depth moved by 3.2 %\n  at the median\n  pixel\nshort");
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
    fn a_table_fits_and_a_file_gets_it_as_it_is() {
        let text = "Mean:\n\n| method | MSE, m² ↓ | AbsRel ↓ |\n| --- | ---: | ---: |\n\
                    | unsharp as sharp as fast | **1.91** (3.5) | 0.294 |\n\nmore";
        assert_eq!(fitted(text, usize::MAX), text);
        for columns in [30, 44, 80, 200] {
            let drawn = fitted(text, columns);
            assert!(drawn.lines().all(|line| line.chars().count() <= columns), "{columns}:\n{drawn}");
            let has = |word: &str| drawn.contains(word);
            assert!(["method", "unsharp", "1.91", "(3.5)", "0.294", "Mean:", "more"].into_iter().all(has));
            assert!(!drawn.contains("---"), "{drawn}");
        }
    }
}
