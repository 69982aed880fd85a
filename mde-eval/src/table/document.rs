use std::fmt::Write as _;

/// Headings, text and tables in order: written as Markdown, or drawn otherwise from its parts.
///
/// ```
/// use mde_eval::table::{Block, Cell, Column, Document, Table};
///
/// let rows = vec![vec![Cell::new("prior"), Cell::new("0.135")], vec![Cell::new("default"), Cell::strong("0.126")]];
/// let table = Table { columns: vec![Column::text("method"), Column::number("AbsRel ↓")], rows };
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

/// A table: every row has one cell per column.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// The columns, from left to right.
    pub columns: Vec<Column>,
    /// The rows, from top to bottom.
    pub rows: Vec<Vec<Cell>>,
}

/// The head of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Its name, with its unit.
    pub head: String,
    /// Whether it holds numbers, which are aligned right.
    pub numeric: bool,
}

impl Column {
    /// A column of words.
    pub fn text(head: impl Into<String>) -> Self {
        Self { head: head.into(), numeric: false }
    }

    /// A column of numbers.
    pub fn number(head: impl Into<String>) -> Self {
        Self { head: head.into(), numeric: true }
    }
}

/// A cell of a [`Table`].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cell {
    /// What stands out: bold in Markdown. May be empty.
    pub strong: String,
    /// What follows it.
    pub text: String,
}

impl Cell {
    /// A plain cell.
    pub fn new(text: impl Into<String>) -> Self {
        Self { strong: String::new(), text: text.into() }
    }

    /// A cell that stands out.
    pub fn strong(text: impl Into<String>) -> Self {
        Self { strong: text.into(), text: String::new() }
    }

    /// Its words without emphasis.
    pub fn plain(&self) -> String {
        format!("{}{}", self.strong, self.text)
    }

    fn markdown(&self) -> String {
        // A bar would end the cell.
        let escaped = |text: &str| inert(text).replace('|', "\\|");
        match self.strong.as_str() {
            "" => escaped(&self.text),
            strong => format!("**{}**{}", escaped(strong), escaped(&self.text)),
        }
    }
}

/// Text without HTML: names come from files.
fn inert(text: &str) -> String {
    text.replace('<', "&lt;")
}

impl Document {
    /// As GitHub's Markdown, with a line break at the end.
    pub fn markdown(&self) -> String {
        let blocks: Vec<String> = self.blocks.iter().map(Block::markdown).collect();
        blocks.join("\n\n") + "\n"
    }
}

impl Block {
    fn markdown(&self) -> String {
        match self {
            Self::Heading(level, text) => format!("{} {}", "#".repeat((*level).clamp(1, 6)), inert(text)),
            Self::Text(text) => inert(text),
            Self::List(lines) => {
                lines.iter().map(|line| format!("- {}", inert(line))).collect::<Vec<_>>().join("\n")
            }
            Self::Table(table) => table.markdown(),
        }
    }
}

impl Table {
    fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
        let mut text = line(self.columns.iter().map(|column| Cell::new(&column.head).markdown()).collect());
        let rule = |column: &Column| if column.numeric { "---:" } else { "---" }.to_owned();
        let _ = write!(text, "\n{}", line(self.columns.iter().map(rule).collect()));
        for row in &self.rows {
            let _ = write!(text, "\n{}", line(row.iter().map(Cell::markdown).collect()));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_no_html() {
        let hostile = "<img src=x onerror=alert(1)>";
        let table = Table {
            columns: vec![Column::text(hostile)],
            rows: vec![vec![Cell::new(hostile)], vec![Cell::strong(hostile)]],
        };
        let blocks = vec![
            Block::Heading(1, hostile.to_owned()),
            Block::Text(hostile.to_owned()),
            Block::List(vec![hostile.to_owned()]),
            Block::Table(table),
        ];
        let text = Document { blocks }.markdown();
        assert!(!text.contains('<') && text.matches("&lt;img").count() == 6, "{text}");
    }
}
