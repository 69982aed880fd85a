use std::fmt::Display;
use std::path::PathBuf;

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
    /// A file with wrong content.
    #[error("{}: {}: {}", line(path.display()), line(place), line(problem))]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, field or byte.
        place: String,
        /// What is wrong there, and what is expected.
        problem: String,
    },
    /// A camera model that cannot be turned into a pinhole camera.
    #[error("{}: camera model {} is not supported; undistort the photographs, or export one of {supported}", line(path.display()), line(model))]
    Model {
        /// The file.
        path: PathBuf,
        /// Its name, or its number.
        model: String,
        /// Those that are read.
        supported: &'static str,
    },
    /// A pose that is not a rigid motion.
    #[error("{}: photograph {}: {problem}; its pose cannot be used", line(path.display()), line(photograph))]
    Rotation {
        /// The file.
        path: PathBuf,
        /// The photograph's name.
        photograph: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A photograph that a capture names and that is not there or can't be read.
    #[error("{}: photograph {} is missing or no image; copy it there, or remove its entry", line(path.display()), line(photograph.display()))]
    Photograph {
        /// The file that names it.
        path: PathBuf,
        /// Where it should be.
        photograph: PathBuf,
    },
    /// A photograph that is not one of the capture.
    #[error("{}: not a photograph of this capture; give one of its {frames}, such as {}", line(photograph.display()), line(some.join(", ")))]
    Foreign {
        /// The photograph.
        photograph: PathBuf,
        /// Number of the capture's photographs.
        frames: usize,
        /// The first of them.
        some: Vec<String>,
    },
    /// Too few photographs with poses.
    #[error("{}: {found} photograph(s) with a pose; at least 2 are needed", line(path.display()))]
    TooFew {
        /// The file.
        path: PathBuf,
        /// How many there are.
        found: usize,
    },
    /// All photographs taken from one place.
    #[error("{}: all photographs were taken from one place, so that nothing has parallax; add some from other places", line(path.display()))]
    NoParallax {
        /// The file.
        path: PathBuf,
    },
    /// A photograph whose size is not that of its camera.
    #[error("the photograph is {}x{} pixels but its camera {}x{}; give the photograph that the camera was calibrated for", found[0], found[1], expected[0], expected[1])]
    Size {
        /// Width and height of the photograph.
        found: [usize; 2],
        /// Width and height of the camera.
        expected: [usize; 2],
    },
    /// A view that cannot be made.
    #[error(transparent)]
    View(#[from] mde_warp::Error),
}

/// The text with control characters escaped, so that names in a file can neither break the line nor control a terminal.
fn line(text: impl Display) -> String {
    let plain = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.to_string().chars().map(plain).collect()
}

/// Shorthand for results of the readers.
pub type Result<T, E = Error> = std::result::Result<T, E>;
