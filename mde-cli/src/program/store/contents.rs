//! What the files of a finished folder were as they were written, by which a later run knows them again.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A number for each file of a folder, by its path within it.
pub(crate) type Contents<T> = BTreeMap<PathBuf, T>;

/// The CRC-32 of each file.
pub(crate) fn checksums(folder: &Path) -> io::Result<Contents<u32>> {
    each(folder, |file| Ok(crc32fast::hash(&fs::read(file)?)))
}

/// The bytes of each file.
pub(crate) fn lengths(folder: &Path) -> io::Result<Contents<u64>> {
    each(folder, |file| Ok(fs::metadata(file)?.len()))
}

/// Whether each of these files is there with that length. Others may be beside them.
pub(crate) fn have_lengths(folder: &Path, lengths: &Contents<u64>) -> bool {
    lengths.iter().all(|(name, length)| {
        fs::metadata(folder.join(name)).is_ok_and(|found| found.is_file() && found.len() == *length)
    })
}

fn each<T>(folder: &Path, of: impl Fn(&Path) -> io::Result<T>) -> io::Result<Contents<T>> {
    let (mut found, mut folders) = (Contents::new(), vec![PathBuf::new()]);
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(folder.join(&inside))? {
            let entry = entry?;
            let name = inside.join(entry.file_name());
            if entry.file_type()?.is_dir() {
                folders.push(name);
            } else {
                let number = of(&entry.path())?;
                found.insert(name, number);
            }
        }
    }
    Ok(found)
}
