use std::path::{Path, PathBuf};

/// Result of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Errors of this crate; each message is one line that names the file or value and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    #[error("{}: can't read: {source}; {}", path.display(), io_remedy(source))]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file could not be written; an older file of that name remains.
    #[error("{}: can't write: {source}; {}", path.display(), io_remedy(source))]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file is empty, truncated, of a wrong type or size, or without any usable value; a model cannot be loaded, fails, or its output is
    /// no depth map.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The reason and the remedy.
        reason: String,
    },
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] mde_uncertainty::OutOfRange),
    /// No profile of that name, or none that matches the file name.
    #[error("no model profile for {name:?}; name one of: {}", crate::spec::PROFILES.join(", "))]
    UnknownProfile {
        /// The name given, or the model's file name.
        name: String,
    },
    /// The error of a prior outside this crate.
    #[error(transparent)]
    External(Box<dyn std::error::Error + Send + Sync>),
    /// An array has the wrong shape or values.
    #[error("{0}")]
    Input(String),
    /// A prediction without a usable pixel, such as that of a crop of the sky; test-time augmentation goes on without it.
    #[error("{0}")]
    Empty(String),
}

impl Error {
    pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), reason: reason.into() }
    }

    pub(crate) fn read(path: &Path, source: std::io::Error) -> Self {
        Self::Read { path: path.to_owned(), source }
    }
}

/// [`Error::Input`] for two maps, by their names and `(height, width)`, that are not of one size.
pub(crate) fn same_size(map: (&str, (usize, usize)), other: (&str, (usize, usize))) -> Result<()> {
    if map.1 == other.1 {
        return Ok(());
    }
    let reason =
        format!("{} is {:?} but {} {:?}; give both one [height, width]", map.0, map.1, other.0, other.1);
    Err(Error::Input(reason))
}

fn io_remedy(source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind;
    match source.kind() {
        ErrorKind::NotFound => "check the path",
        ErrorKind::PermissionDenied => "check the permissions",
        ErrorKind::IsADirectory => "give a file, not a folder",
        ErrorKind::InvalidData => "give a text file",
        ErrorKind::InvalidInput => "give a regular file",
        ErrorKind::FileTooLarge => "give a smaller file",
        ErrorKind::StorageFull => "free some space",
        _ => "check that the file and its folder are accessible",
    }
}
