use super::Table;

impl Table {
    /// Plain text: columns as wide as their longest cell, two spaces apart; numbers are aligned right. What stands out is as the rest.
    pub fn aligned(&self) -> String {
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
