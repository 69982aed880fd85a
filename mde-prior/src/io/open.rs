//! The one way to open a file: it is regular, and of a bounded size for its kind.

use std::fs::{File, Metadata};
use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::Path;

/// What a file holds, which decides how many bytes of it are read at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FileKind {
    /// A photograph: 2 GiB.
    Photograph,
    /// A depth map: 4 GiB.
    DepthMap,
    /// A network: 4 GiB.
    Network,
    /// Weights beside a network: 64 GiB.
    Weights,
    /// Settings, a calibration or another JSON or TOML file: 64 MiB.
    Settings,
    /// A list or a table as text: 1 GiB.
    Text,
}

impl FileKind {
    /// Most bytes of such a file.
    #[must_use]
    pub fn limit(self) -> u64 {
        match self {
            Self::Settings => 64 << 20,
            Self::Text => 1 << 30,
            Self::Photograph => 2 << 30,
            Self::DepthMap | Self::Network => 4 << 30,
            Self::Weights => 64 << 30,
        }
    }
}

/// Metadata of a file that [`open`] would open, for libraries that open it by its path.
///
/// # Errors
/// Those of [`open`].
pub fn check(path: impl AsRef<Path>, kind: FileKind) -> Result<Metadata> {
    let found = std::fs::metadata(path)?;
    check_found(&found, kind)?;
    Ok(found)
}

/// Opens a regular file for reading; links are followed. A named pipe or a device is refused without being opened, which could
/// block or never end.
///
/// # Errors
/// Those of the system; [`ErrorKind::IsADirectory`] for a folder, [`ErrorKind::InvalidInput`] for another file that is not
/// regular, [`ErrorKind::FileTooLarge`] above the [limit](FileKind::limit).
pub fn open(path: impl AsRef<Path>, kind: FileKind) -> Result<File> {
    check(&path, kind)?;
    let file = File::open(path)?;
    check_found(&file.metadata()?, kind)?;
    Ok(file)
}

/// The bytes of a file, read once.
///
/// # Errors
/// Those of [`open`].
pub fn read(path: impl AsRef<Path>, kind: FileKind) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // The file may have grown, or have no length, as in /proc.
    open(path, kind)?.take(kind.limit() + 1).read_to_end(&mut bytes)?;
    check_size(bytes.len() as u64, kind)?;
    Ok(bytes)
}

/// The text of a file, read once.
///
/// # Errors
/// Those of [`open`], and [`ErrorKind::InvalidData`] where it is not UTF-8.
pub fn read_text(path: impl AsRef<Path>, kind: FileKind) -> Result<String> {
    String::from_utf8(read(path, kind)?)
        .map_err(|_| Error::new(ErrorKind::InvalidData, "it is no text in UTF-8"))
}

fn check_found(found: &Metadata, kind: FileKind) -> Result<()> {
    if found.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, "it is a folder"));
    }
    if !found.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, "it is a named pipe, a socket or a device"));
    }
    check_size(found.len(), kind)
}

fn check_size(bytes: u64, kind: FileKind) -> Result<()> {
    if bytes <= kind.limit() {
        return Ok(());
    }
    let most = match kind.limit() >> 30 {
        0 => format!("{} MiB", kind.limit() >> 20),
        gib => format!("{gib} GiB"),
    };
    Err(Error::new(ErrorKind::FileTooLarge, format!("it has more than {most}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_regular_file_is_read_through_a_link_and_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, "{}").unwrap();
        assert_eq!(read_text(&path, FileKind::Settings).unwrap(), "{}");
        std::fs::write(&path, [0xff]).unwrap();
        assert_eq!(read_text(&path, FileKind::Settings).unwrap_err().kind(), ErrorKind::InvalidData);
        // A sparse file, of which nothing is read.
        File::create(&path).unwrap().set_len(FileKind::Settings.limit() + 1).unwrap();
        let error = read(&path, FileKind::Settings).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert_eq!(error.to_string(), "it has more than 64 MiB");
    }
}
