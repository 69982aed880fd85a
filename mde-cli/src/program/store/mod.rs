//! Folders that are written whole, and finished work, known again by what it was made from.

mod folder;
pub(crate) mod lock;

pub(crate) use folder::*;

use crate::program::write_json;
use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The record of a finished folder. It is written last, in a folder that appears by a rename.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Entry<R> {
    /// Everything that the files depend on.
    pub(crate) made_from: Value,
    /// The row for the tables.
    pub(crate) row: R,
    /// Length and CRC-32 of the other files, by their paths in the folder.
    pub(crate) files: BTreeMap<PathBuf, (u64, u32)>,
}

fn content(bytes: &[u8]) -> (u64, u32) {
    (bytes.len() as u64, crc32fast::hash(bytes))
}

impl<R: Serialize + DeserializeOwned> Entry<R> {
    /// Records a folder with the files that are in it, in the file `name`.
    pub(crate) fn write(folder: &Path, name: &str, made_from: Value, row: R) -> Result<()> {
        let mut files = BTreeMap::new();
        for path in files_in(folder).with_context(|| folder.display().to_string())? {
            let full = folder.join(&path);
            let bytes = fs::read(&full).with_context(|| full.display().to_string())?;
            files.insert(path, content(&bytes));
        }
        write_json(&folder.join(name), &Self { made_from, row, files })
    }

    /// The entry of a folder; none where there is none, it is broken, or a file has another length. Other files may be beside them.
    pub(crate) fn read(folder: &Path, name: &str) -> Option<Self> {
        let entry: Self = serde_json::from_slice(&fs::read(folder.join(name)).ok()?).ok()?;
        let whole = |(name, (length, _)): (&PathBuf, &(u64, u32))| {
            fs::metadata(folder.join(name)).is_ok_and(|found| found.is_file() && found.len() == *length)
        };
        entry.files.iter().all(whole).then_some(entry)
    }

    /// The bytes of a file; none where they are not those that were written.
    pub(crate) fn file(&self, folder: &Path, name: &str) -> Option<Vec<u8>> {
        let bytes = fs::read(folder.join(name)).ok()?;
        (self.files.get(Path::new(name)) == Some(&content(&bytes))).then_some(bytes)
    }
}
