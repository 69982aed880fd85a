//! The index of many photographs: `index.json`, `index.csv` and `index.html`.

use crate::output::every::PhotographRow;
use crate::output::record::versions;
use crate::program::many::item::THUMBNAIL;
use crate::program::provenance::{command_line, write_json};
use crate::program::report::photographs_page;
use anyhow::{Context, Result, ensure};
use mde_eval::table::inert;
use mde_prior::{FileKind, open};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

pub(crate) const RECORD: &str = "index.json";
pub(crate) const PAGE: &str = "index.html";
pub(crate) const TABLE: &str = "index.csv";
/// Names that no photograph's folder gets.
pub(crate) const RESERVED: [&str; 3] = [RECORD, PAGE, TABLE];
/// Who writes the folder.
const PROGRAM: &str = "mde refine PHOTOS";

/// The index of a folder.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Index {
    program: String,
    versions: std::collections::BTreeMap<String, String>,
    command_line: String,
    /// Number of its photographs, of which those that have been tried are listed.
    all: usize,
    #[serde(rename = "photographs")]
    pub(crate) rows: Vec<PhotographRow>,
}

/// Refuses a folder with other things in it than the program's.
pub(super) fn check_folder(folder: &Path) -> Result<()> {
    let shown = folder.display();
    if !folder.exists() {
        return Ok(());
    }
    ensure!(folder.is_dir(), "{shown}: exists and is not a folder; give another name to -o");
    let mut empty = true;
    for entry in fs::read_dir(folder).with_context(|| shown.to_string())? {
        let name = entry.with_context(|| shown.to_string())?.file_name();
        let name = name.to_string_lossy();
        if name == RECORD && Index::read(&folder.join(RECORD)).is_ok() {
            return Ok(());
        }
        empty &= name.starts_with(".mde-");
    }
    ensure!(
        empty,
        "{shown}: holds no {RECORD} of an earlier run on many photographs; give another name to -o"
    );
    Ok(())
}

impl Index {
    pub(super) fn new(all: usize) -> Self {
        Self {
            program: PROGRAM.to_owned(),
            versions: versions()
                .into_iter()
                .map(|(name, version)| (name.to_owned(), version.to_owned()))
                .collect(),
            command_line: command_line(),
            all,
            rows: Vec::new(),
        }
    }

    pub(super) fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let text =
            open::read_text(path, FileKind::Text).with_context(|| format!("{shown}: can't be read"))?;
        let read: Self =
            serde_json::from_str(&text).with_context(|| format!("{shown}: is no index of mde refine"))?;
        ensure!(read.program == PROGRAM, "{shown}: is no index of mde refine");
        Ok(read)
    }

    /// Marks the folder as the program's. An earlier index stays.
    pub(super) fn mark(&self, folder: &Path) -> Result<()> {
        let path = folder.join(RECORD);
        if Self::read(&path).is_ok() { Ok(()) } else { write_json(&path, self) }
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
    fn a_folder_of_others_is_refused_and_one_of_the_programs_is_taken() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        check_folder(&folder).unwrap();
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join(".mde-AbCdEf"), "").unwrap();
        check_folder(&folder).unwrap();
        fs::write(folder.join("thesis.txt"), "years").unwrap();
        assert!(check_folder(&folder).unwrap_err().to_string().contains("another name to -o"));
        fs::write(folder.join(RECORD), "{}").unwrap();
        assert!(check_folder(&folder).is_err());
        let index = Index::new(1);
        index.write(&folder).unwrap();
        check_folder(&folder).unwrap();
        assert_eq!(Index::read(&folder.join(RECORD)).unwrap(), index);
    }

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
