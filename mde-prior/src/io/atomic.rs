use std::io::Write;
use std::path::Path;

use crate::{Error, Result};

/// Writes a file atomically: to a temporary name in the same folder, then renamed.
///
/// # Errors
/// [`Error::Write`] when the folder is missing or not writable, or the disk is full; an older file of that name then remains.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    // What a killed run leaves.
    builder.prefix(".mde-");
    // Temporary files are private by default; a result has the permissions of the user's umask.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let write = || {
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    };
    write().map_err(|source| Error::Write { path: path.to_owned(), source })
}
