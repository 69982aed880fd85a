use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Errors of the files of a capture. Each text is one line: control characters of names and values are escaped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read.
    #[error("{}: {source}", line(path.display()))]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// Content that is wrong or of no use, with the file and the place in it.
    #[error("{}", line(.0))]
    Content(String),
    /// A view that cannot be made.
    #[error(transparent)]
    View(#[from] mde_warp::Error),
}

/// The text with control characters escaped, so that names in a file can neither break the line nor control a terminal.
fn line(text: impl Display) -> String {
    let plain = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.to_string().chars().map(plain).collect()
}

/// A fault of a file's content.
pub(super) fn fault(path: &Path, problem: impl Display) -> Error {
    Error::Content(format!("{}: {problem}", path.display()))
}

/// A fault at a line, field or byte.
pub(super) fn content(path: &Path, place: impl Display, problem: impl Display) -> Error {
    fault(path, format_args!("{place}: {problem}"))
}

/// A camera model that cannot be turned into a pinhole camera.
pub(super) fn unsupported(path: &Path, model: &str, supported: &str) -> Error {
    let remedy = format!("undistort the photographs, or export one of {supported}");
    fault(path, format_args!("camera model {model} is not supported; {remedy}"))
}

/// A photograph that a file names and that is not there or can't be read.
pub(super) fn missing(path: &Path, photograph: &Path) -> Error {
    let shown = photograph.display();
    fault(path, format_args!("photograph {shown} is missing or no image; copy it there, or remove its entry"))
}

/// Shorthand for results of the readers.
pub type Result<T, E = Error> = std::result::Result<T, E>;
