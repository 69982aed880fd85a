use super::{Block, Document, Table};

impl Table {
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

impl Document {
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
