//! Finished work, known again by what it was made from.

use crate::program::provenance::write_json;
use crate::program::store::folder::files_in;
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
    /// The other files, by their paths in the folder.
    pub(crate) files: BTreeMap<PathBuf, Content>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Content {
    bytes: u64,
    crc32: u32,
}

impl Content {
    fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, crc32: crc32fast::hash(bytes) }
    }
}

impl<R: Serialize> Entry<R> {
    /// Records a folder with the files that are in it, in the file `name`.
    pub(crate) fn write(folder: &Path, name: &str, made_from: Value, row: R) -> Result<()> {
        let mut files = BTreeMap::new();
        for path in files_in(folder).with_context(|| folder.display().to_string())? {
            let full = folder.join(&path);
            let bytes = fs::read(&full).with_context(|| full.display().to_string())?;
            files.insert(path, Content::of(&bytes));
        }
        write_json(&folder.join(name), &Self { made_from, row, files })
    }
}

impl<R: DeserializeOwned> Entry<R> {
    /// The entry of a folder; none where there is none or it is broken.
    pub(crate) fn read(folder: &Path, name: &str) -> Option<Self> {
        serde_json::from_slice(&fs::read(folder.join(name)).ok()?).ok()
    }
}

impl<R> Entry<R> {
    /// Whether each file is there with its length. Others may be beside them.
    pub(crate) fn has_lengths(&self, folder: &Path) -> bool {
        self.files.iter().all(|(name, content)| {
            let found = fs::metadata(folder.join(name));
            found.is_ok_and(|found| found.is_file() && found.len() == content.bytes)
        })
    }

    /// The bytes of a file with the recorded length and checksum; otherwise the reason of the refusal.
    pub(crate) fn file(&self, folder: &Path, name: &str) -> Result<Vec<u8>, String> {
        let path = folder.join(name);
        let bytes = fs::read(&path).map_err(|error| format!("{} can't be read: {error}", path.display()))?;
        match self.files.get(Path::new(name)) == Some(&Content::of(&bytes)) {
            true => Ok(bytes),
            false => Err(format!("{} is not as it was written", path.display())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_changed_file_is_noticed_by_its_length_or_its_checksum() {
        let place = tempfile::tempdir().unwrap();
        fs::create_dir(place.path().join("in")).unwrap();
        fs::write(place.path().join("in/a.npy"), "abc").unwrap();
        Entry::write(place.path(), "e.json", json!("x"), 0.1_f64).unwrap();
        let read = Entry::<f64>::read(place.path(), "e.json").unwrap();
        assert_eq!((&read.made_from, read.row), (&json!("x"), 0.1));
        assert!(read.has_lengths(place.path()));
        assert_eq!(read.file(place.path(), "in/a.npy").unwrap(), b"abc");
        fs::write(place.path().join("in/a.npy"), "abd").unwrap();
        assert!(read.has_lengths(place.path()) && read.file(place.path(), "in/a.npy").is_err());
        fs::write(place.path().join("in/a.npy"), "ab").unwrap();
        assert!(!read.has_lengths(place.path()));
        fs::write(place.path().join("e.json"), "{").unwrap();
        assert!(Entry::<f64>::read(place.path(), "e.json").is_none());
    }
}
