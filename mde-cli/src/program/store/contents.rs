//! What the files of a finished folder were as they were written, by which a later run knows them again.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The bytes of each file of a folder, by its path within it.
pub(crate) type Contents = BTreeMap<PathBuf, u64>;

/// The bytes of each file.
pub(crate) fn lengths(folder: &Path) -> io::Result<Contents> {
    let (mut found, mut folders) = (Contents::new(), vec![PathBuf::new()]);
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(folder.join(&inside))? {
            let entry = entry?;
            let name = inside.join(entry.file_name());
            if entry.file_type()?.is_dir() {
                folders.push(name);
            } else {
                found.insert(name, entry.metadata()?.len());
            }
        }
    }
    Ok(found)
}

/// Whether each of these files is there with that length. Others may be beside them.
pub(crate) fn have_lengths(folder: &Path, lengths: &Contents) -> bool {
    lengths.iter().all(|(name, length)| {
        fs::metadata(folder.join(name)).is_ok_and(|found| found.is_file() && found.len() == *length)
    })
}
