//! The lock of a folder that is written for long.

use anyhow::{Context, Result, bail};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// The locked file. The system releases the lock of a process that ends, so one that is left here is taken over.
pub(crate) const FILE: &str = ".mde-lock";

/// A folder that no other process writes to.
pub(crate) struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Locks a folder; `None` on a file system without locks.
    pub(crate) fn take(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(FILE);
        let shown = path.display();
        // Again where the file was removed by its last holder between its opening and its locking.
        for _ in 0..100 {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options
                .open(&path)
                .with_context(|| format!("{shown}: can't write there; give another name to -o"))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    let _ = file.read_to_string(&mut holder);
                    bail!(
                        "{}: another process ({}) is writing this folder; wait for it, or give another name to -o",
                        folder.display(),
                        holder.trim()
                    );
                }
                Err(TryLockError::Error(_)) => {
                    let _ = std::fs::remove_file(&path);
                    return Ok(None);
                }
            }
            if is_at(&file, &path) {
                let _ = file.set_len(0);
                let _ = writeln!(file, "{}", std::process::id());
                return Ok(Some(Self { path, file }));
            }
        }
        bail!("{shown}: can't be locked; remove it")
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

/// Whether the open file is the one of that name.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same = file.metadata().ok().zip(std::fs::metadata(path).ok());
    same.is_some_and(|(a, b)| (a.dev(), a.ino()) == (b.dev(), b.ino()))
}

/// Elsewhere an open file is not removed.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}
