//! `report.html`: one self-contained page that shows a finished folder. It is made from the folder's files alone, at any time.

mod capture;
mod encode;
mod evaluation;
mod index;
mod page;
mod run;

pub(crate) use evaluation::{FIGURES, PICTURE};
pub(crate) use index::photographs_page;

use crate::output::every::{CLOUD, MESHES, PhotographRow};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::output::files::THUMBNAIL;
use crate::program::store::RECORD;
use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) const FILE: &str = "report.html";
/// The page of all photographs of a capture.
pub(crate) const INDEX: &str = "index.html";

/// The page of all photographs of a capture in its folder, before the record is written.
pub(crate) fn every_page(folder: &Path, rows: &[PhotographRow]) -> Result<String> {
    let files = [CLOUD, MESHES[0], MESHES[1], TRANSFORMS, RECORD];
    let there = |file: &&str| *file == RECORD || folder.join(file).is_file();
    let files: Vec<&str> = files.into_iter().filter(there).collect();
    let view = capture::view(folder, rows)?;
    let rows: Vec<&PhotographRow> = rows.iter().collect();
    Ok(photographs_page(&rows, rows.len(), THUMBNAIL, &files, view.as_deref()))
}

/// Writes the page of a run's or an evaluation's folder into it, atomically; of a whole capture also those of its photographs.
pub(crate) fn write(folder: &Path) -> Result<PathBuf> {
    let (mut name, record) = (FILE, folder.join(RECORD));
    let html = if folder.join(evaluation::SUMMARY).is_file() {
        evaluation::page(folder)?
    } else if record.is_file() {
        match read_json::<Every>(&record)?.photographs {
            Some(rows) => {
                for name in rows.iter().filter_map(|row| row.folder.as_deref()) {
                    ensure!(
                        Path::new(name).file_name() == Some(OsStr::new(name)),
                        "{}: {name} is no name of a folder beside it; run the command again",
                        record.display()
                    );
                    write(&folder.join(name))?;
                }
                name = INDEX;
                every_page(folder, &rows)?
            }
            None => run::page(folder)?,
        }
    } else {
        bail!(
            "{}: holds neither {RECORD} nor {}; give a folder that mde refine, demo, eval or ablate wrote",
            folder.display(),
            evaluation::SUMMARY
        )
    };
    let path = folder.join(name);
    mde_prior::write_atomic(&path, html.as_bytes())?;
    Ok(path)
}

/// What the record of a run has that refined every photograph of a capture.
#[derive(Deserialize)]
struct Every {
    photographs: Option<Vec<PhotographRow>>,
}

fn read_text(path: &Path) -> Result<String> {
    fs::read_to_string(path)
        .with_context(|| format!("{}: can't be read; the report needs it", path.display()))
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    serde_json::from_str(&read_text(path)?)
        .with_context(|| format!("{}: broken; run the command again", path.display()))
}
