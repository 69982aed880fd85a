/// Headings, text and tables in order: written as Markdown, or drawn otherwise from its parts.
///
/// ```
/// use mde_eval::table::{Block, Document, Table};
///
/// let rows = [["prior", "0.135"], ["default", "**0.126**"]].map(|row| row.map(str::to_owned).to_vec());
/// let table = Table::new(1, ["method", "AbsRel ↓"], rows);
/// let document = Document { blocks: vec![Block::Heading(2, "Depth".to_owned()), Block::Table(table)] };
/// assert_eq!(
///     document.markdown(),
///     "## Depth\n\n| method | AbsRel ↓ |\n| --- | ---: |\n| prior | 0.135 |\n| default | **0.126** |\n"
/// );
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Document {
    /// Its parts, from top to bottom.
    pub blocks: Vec<Block>,
}

/// One part of a [`Document`].
#[derive(Debug, Clone, PartialEq)]
pub enum Block {
    /// A heading and its level, 1 for the title.
    Heading(usize, String),
    /// A paragraph.
    Text(String),
    /// A list of one line each.
    List(Vec<String>),
    /// A table.
    Table(Table),
}

/// A table: every row has one cell per head. What stands out begins a cell, between `**`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// How many columns hold words; the columns after them hold numbers, which are aligned right.
    pub words: usize,
    /// Names of the columns with their units, from left to right.
    pub heads: Vec<String>,
    /// The rows, from top to bottom.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table whose first `words` columns hold words, the others numbers.
    pub fn new<H: Into<String>>(
        words: usize,
        heads: impl IntoIterator<Item = H>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        let heads = heads.into_iter().map(Into::into).collect();
        Self { words, heads, rows: rows.into_iter().collect() }
    }

    fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
        // A bar would end the cell.
        let row = |row: &Vec<String>| line(row.iter().map(|cell| inert(cell).replace('|', "\\|")).collect());
        let rule = |column| if column < self.words { "---" } else { "---:" }.to_owned();
        let mut lines = vec![row(&self.heads), line((0..self.heads.len()).map(rule).collect())];
        lines.extend(self.rows.iter().map(row));
        lines.join("\n")
    }

    /// Plain text: columns as wide as their longest cell, two spaces apart; numbers are aligned right. What stands out is as the rest.
    pub fn text(&self) -> String {
        let plain = |cell: &String| match cell.strip_prefix("**") {
            Some(strong) => strong.replacen("**", "", 1),
            None => cell.clone(),
        };
        let rows = std::iter::once(&self.heads).chain(&self.rows);
        let rows: Vec<Vec<String>> = rows.map(|row| row.iter().map(plain).collect()).collect();
        let length = |cell: &String| cell.chars().count();
        let width =
            |column: usize| rows.iter().filter_map(|row| row.get(column)).map(length).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.heads.len()).map(width).collect();
        let line = |row: &Vec<String>| {
            let cells = row.iter().zip(&widths).enumerate();
            let padded = cells.map(|(column, (cell, &width))| match column < self.words {
                true => format!("{cell:width$}"),
                false => format!("{cell:>width$}"),
            });
            padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        };
        rows.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

/// Text without HTML: names come from files.
fn inert(text: &str) -> String {
    text.replace('<', "&lt;")
}

impl Document {
    /// As GitHub's Markdown, with a line break at the end.
    pub fn markdown(&self) -> String {
        let block = |block: &Block| match block {
            Block::Heading(level, text) => format!("{} {}", "#".repeat((*level).clamp(1, 6)), inert(text)),
            Block::Text(text) => inert(text),
            Block::List(lines) => {
                lines.iter().map(|line| format!("- {}", inert(line))).collect::<Vec<_>>().join("\n")
            }
            Block::Table(table) => table.markdown(),
        };
        self.blocks.iter().map(block).collect::<Vec<_>>().join("\n\n") + "\n"
    }

    /// As plain text in lines of at most so many columns; tables are as wide as their cells.
    pub fn text(&self, columns: usize) -> String {
        let block = |block: &Block| match block {
            Block::Heading(level, text) => wrapped(&format!("{} {text}", "#".repeat(*level)), columns, 2),
            Block::Text(text) => wrapped(text, columns, 2),
            Block::List(lines) => wrapped(&format!("- {}", lines.join("\n- ")), columns, 2),
            Block::Table(table) => table.text(),
        };
        self.blocks.iter().map(block).collect::<Vec<_>>().join("\n\n")
    }
}

/// Breaks the lines that are longer than `columns` between words, and indents what follows.
pub fn wrapped(text: &str, columns: usize, indent: usize) -> String {
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
    fn names_are_no_html() {
        let hostile = || "<img src=x onerror=alert(1)>".to_owned();
        let rows = [vec![hostile()], vec![format!("**{}**", hostile())]];
        let blocks = vec![
            Block::Heading(1, hostile()),
            Block::Text(hostile()),
            Block::List(vec![hostile()]),
            Block::Table(Table::new(1, [hostile()], rows)),
        ];
        let text = Document { blocks }.markdown();
        assert!(!text.contains('<') && text.matches("&lt;img").count() == 6, "{text}");
    }

    #[test]
    fn lines_break_between_words_and_lose_none() {
        let text = "depth: typical change of 3.2 % per pixel\nshort";
        let broken = wrapped(text, 20, 2);
        assert_eq!(broken, "depth: typical\n  change of 3.2 %\n  per pixel\nshort");
        for (columns, indent) in [(usize::MAX, 2), (12, 9), (0, 2), (1, 0), (60, 2)] {
            let broken = wrapped(text, columns, indent);
            assert!(broken.split_whitespace().eq(text.split_whitespace()), "{columns}: {broken}");
        }
        let long = wrapped("a-word-longer-than-the-line and more", 12, 2);
        assert_eq!(long, "a-word-longer-than-the-line\n  and more");
    }

    #[test]
    fn a_table_is_aligned() {
        let rows = [["fast", "**1.91** (3.5)", "0.294"], ["unsharp as fast", "2", "0.3"]];
        let rows = rows.map(|row| row.map(str::to_owned).to_vec());
        let table = Table::new(1, ["method", "MSE, m² ↓", "AbsRel ↓"], rows);
        let blocks = vec![Block::Text("Mean:".to_owned()), Block::Table(table)];
        let document = Document { blocks };
        let expected = "Mean:\n\n\
                        method            MSE, m² ↓  AbsRel ↓\n\
                        fast             1.91 (3.5)     0.294\n\
                        unsharp as fast           2       0.3";
        assert_eq!(document.text(80), expected);
    }
}
