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
}
