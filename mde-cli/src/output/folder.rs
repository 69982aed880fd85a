//! The folder of a result: the list of its files, and the step by which it gets its name.

use serde::Deserialize;
use std::fs;
use std::io::{Error, Result};
use std::path::{Path, PathBuf};

/// The file that marks the folder of an earlier run.
pub const RECORD: &str = "run.json";

/// The files within a folder, by their paths from it.
///
/// # Errors
/// Those of the file system.
pub fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut files, mut folders) = (Vec::new(), vec![PathBuf::new()]);
    while let Some(inside) = folders.pop() {
        for found in fs::read_dir(folder.join(&inside))? {
            let found = found?;
            let path = inside.join(found.file_name());
            if found.file_type()?.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    Ok(files)
}

/// Adds the names of all files to a folder's record, where it has one that does not name them. `--force` removes no others.
///
/// # Errors
/// Those of the file system.
pub fn list_files(folder: &Path) -> Result<()> {
    let record = folder.join(RECORD);
    if !record.exists() || listed_files(folder).is_ok() {
        return Ok(());
    }
    let (text, files) = (fs::read_to_string(&record)?, files_in(folder)?);
    let open = text.trim_end().strip_suffix('}').map(str::trim_end).unwrap_or_default();
    if !open.is_empty() {
        let text = format!("{open},\n  \"files\": {}\n}}\n", serde_json::to_string(&files)?);
        mde_prior::write_atomic(&record, text.as_bytes()).map_err(Error::other)?;
    }
    Ok(())
}

/// The files that a folder's record names.
///
/// # Errors
/// Those of the file system, and [`InvalidData`](std::io::ErrorKind::InvalidData) for a record that names none.
pub fn listed_files(folder: &Path) -> Result<Vec<PathBuf>> {
    #[derive(Deserialize)]
    struct Record {
        files: Vec<PathBuf>,
    }
    Ok(serde_json::from_str::<Record>(&fs::read_to_string(folder.join(RECORD))?)?.files)
}

/// Gives the folder `new` the name `target`, on the same file system, and removes what had that name: in one exchange where the file
/// system can, so that a process killed here leaves the old folder or the new one.
///
/// # Errors
/// Those of the file system; the old folder then keeps its name.
pub fn exchange(new: &Path, target: &Path) -> Result<()> {
    if !target.exists() {
        return fs::rename(new, target);
    }
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        if renameat_with(CWD, new, CWD, target, RenameFlags::EXCHANGE).is_ok() {
            return fs::remove_dir_all(new);
        }
    }
    let mut aside = new.as_os_str().to_owned();
    aside.push(".old");
    let aside = Path::new(&aside);
    fs::rename(target, aside)?;
    fs::rename(new, target).inspect_err(|_| {
        let _ = fs::rename(aside, target);
    })?;
    fs::remove_dir_all(aside)
}
