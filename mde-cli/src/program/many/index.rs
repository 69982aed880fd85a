//! The index of many photographs: `index.json`, `index.csv` and `index.html`.

use crate::output::every::PhotographRow;
use crate::output::record::versions;
use crate::program::many::item::THUMBNAIL;
use crate::program::provenance::{command_line, write_json};
use crate::program::report::photographs_page;
use crate::program::store::folder::{check_own, read_record};
use anyhow::Result;
use mde_eval::table::inert;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) const RECORD: &str = "index.json";
pub(crate) const PAGE: &str = "index.html";
pub(crate) const TABLE: &str = "index.csv";
/// Names that no photograph's folder gets.
pub(crate) const RESERVED: [&str; 3] = [RECORD, PAGE, TABLE];
/// Who writes the folder.
const PROGRAM: &str = "mde refine PHOTOS";

/// The index of a folder.
#[derive(Debug, Serialize)]
pub(crate) struct Index {
    program: &'static str,
    versions: BTreeMap<&'static str, &'static str>,
    command_line: String,
    /// Number of its photographs, of which those that have been tried are listed.
    all: usize,
    #[serde(rename = "photographs")]
    pub(crate) rows: Vec<PhotographRow>,
}

/// Refuses a folder with other things in it than the program's.
pub(super) fn check_folder(folder: &Path) -> Result<()> {
    check_own(folder, |path| path.ends_with(RECORD) && is_index(path), |_| false, RECORD)
}

fn is_index(path: &Path) -> bool {
    read_record(path).is_some_and(|record| record["program"] == PROGRAM)
}

impl Index {
    pub(super) fn new(all: usize) -> Self {
        let (versions, command_line) = (versions(), command_line());
        Self { program: PROGRAM, versions, command_line, all, rows: Vec::new() }
    }

    /// Marks the folder as the program's. An earlier index stays.
    pub(super) fn mark(&self, folder: &Path) -> Result<()> {
        let path = folder.join(RECORD);
        if is_index(&path) { Ok(()) } else { write_json(&path, self) }
    }

    /// Writes the index of the photographs that have been tried. Each file appears whole.
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        mde_prior::write_atomic(&folder.join(TABLE), &csv(&self.rows)?)?;
        let page = photographs_page(&self.rows, self.all, THUMBNAIL, &[TABLE, RECORD]);
        mde_prior::write_atomic(&folder.join(PAGE), page.as_bytes())?;
        write_json(&folder.join(RECORD), self)
    }
}

const COLUMNS: [&str; 18] = [
    "photograph",
    "folder",
    "status",
    "error",
    "width",
    "height",
    "fx",
    "camera",
    "seconds",
    "unit",
    "median_depth",
    "sigma_over_depth_median",
    "sigma_over_depth_90",
    "missing_pixels",
    "warnings",
    "same_scale",
    "same_scale_sigma",
    "same_scale_group",
];

fn csv(rows: &[PhotographRow]) -> Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(COLUMNS)?;
    let number = |value: Option<f64>| value.map(|v| format!("{v:.6}")).unwrap_or_default();
    for row in rows {
        table.write_record([
            inert(&row.photograph),
            inert(row.folder.as_deref().unwrap_or_default()),
            row.status().to_owned(),
            inert(row.error.as_deref().unwrap_or_default()),
            row.width.to_string(),
            row.height.to_string(),
            number(row.fx),
            row.camera.clone(),
            format!("{:.3}", row.seconds),
            row.unit.clone(),
            number(row.median_depth),
            number(row.sigma),
            number(row.sigma_90),
            row.missing.to_string(),
            row.warnings.len().to_string(),
            number(row.same_scale),
            number(row.same_scale_sigma),
            row.same_scale_group.map(|group| group.to_string()).unwrap_or_default(),
        ])?;
    }
    Ok(table.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_quotes_what_needs_it() {
        let failed = PhotographRow::failed("a,\"b\".jpg", "no\nphotograph");
        let formula = PhotographRow { folder: Some("-1".to_owned()), ..PhotographRow::new("=cmd.png") };
        let done = PhotographRow { median_depth: Some(2.5), sigma: Some(0.125), ..PhotographRow::default() };
        let table = String::from_utf8(csv(&[failed, done, formula]).unwrap()).unwrap();
        let mut read = csv::Reader::from_reader(table.as_bytes());
        let rows: Vec<csv::StringRecord> = read.records().map(Result::unwrap).collect();
        assert_eq!((&rows[0][0], &rows[0][2], &rows[0][3]), ("a,\"b\".jpg", "failed", "no\nphotograph"));
        assert_eq!((&rows[1][2], &rows[1][10], &rows[1][11]), ("done", "2.500000", "0.125000"));
        assert_eq!((&rows[2][0], &rows[2][1]), ("'=cmd.png", "'-1"));
    }
}
