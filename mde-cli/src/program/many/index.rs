//! The index of many photographs: `index.json`, `index.csv` and `index.html`.

use crate::output::every::PhotographRow;
use crate::output::files::THUMBNAIL;
use crate::output::record::versions;
use crate::program::report::photographs_page;
use crate::program::{command_line, write_json};
use anyhow::Result;
use mde_eval::table::inert;
use serde_json::json;
use std::path::Path;

pub(super) const RECORD: &str = "index.json";
pub(super) const PAGE: &str = "index.html";
pub(super) const TABLE: &str = "index.csv";
/// Beside the folders of the photographs.
pub(super) const FILES: [&str; 3] = [RECORD, PAGE, TABLE];

/// Writes the index of those of `all` photographs that have been tried. Each file appears whole.
pub(super) fn write(folder: &Path, rows: &[&PhotographRow], all: usize) -> Result<()> {
    mde_prior::write_atomic(&folder.join(TABLE), &csv(rows)?)?;
    let page = photographs_page(rows, all, THUMBNAIL, &[TABLE, RECORD], None);
    mde_prior::write_atomic(&folder.join(PAGE), page.as_bytes())?;
    let record =
        json!({ "versions": versions(), "command_line": command_line(), "all": all, "photographs": rows });
    write_json(&folder.join(RECORD), &record)
}

/// The columns of the table with the cells of a row.
fn cells(row: &PhotographRow) -> [(&'static str, String); 18] {
    let number = |value: Option<f64>| value.map(|v| format!("{v:.6}")).unwrap_or_default();
    let text = |text: &Option<String>| inert(text.as_deref().unwrap_or_default());
    [
        ("photograph", inert(&row.photograph)),
        ("folder", text(&row.folder)),
        ("status", row.status().to_owned()),
        ("error", text(&row.error)),
        ("width", row.width.to_string()),
        ("height", row.height.to_string()),
        ("fx", number(row.fx)),
        ("camera", row.camera.clone()),
        ("seconds", format!("{:.3}", row.seconds)),
        ("unit", row.unit.clone()),
        ("median_depth", number(row.median_depth)),
        ("sigma_over_depth_median", number(row.sigma)),
        ("sigma_over_depth_90", number(row.sigma_90)),
        ("missing_pixels", row.missing.to_string()),
        ("warnings", row.warnings.len().to_string()),
        ("same_scale", number(row.same_scale)),
        ("same_scale_sigma", number(row.same_scale_sigma)),
        ("same_scale_group", row.same_scale_group.map(|group| group.to_string()).unwrap_or_default()),
    ]
}

fn csv(rows: &[&PhotographRow]) -> Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(cells(&PhotographRow::default()).map(|(column, _)| column))?;
    for row in rows {
        table.write_record(cells(row).map(|(_, cell)| cell))?;
    }
    Ok(table.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_quotes_what_needs_it() {
        let failed = PhotographRow::failed("=a,\"b\".jpg", "no\nphotograph");
        let (folder, median_depth, sigma) = (Some("-1".to_owned()), Some(2.5), Some(0.125));
        let done = PhotographRow { folder, median_depth, sigma, ..PhotographRow::default() };
        let table = csv(&[&failed, &done]).unwrap();
        let rows: Vec<_> = csv::Reader::from_reader(&*table).into_records().map(Result::unwrap).collect();
        assert_eq!((&rows[0][0], &rows[0][2], &rows[0][3]), ("'=a,\"b\".jpg", "failed", "no\nphotograph"));
        let of = [1, 2, 10, 11].map(|column| &rows[1][column]);
        assert_eq!(of, ["'-1", "done", "2.500000", "0.125000"]);
    }
}
