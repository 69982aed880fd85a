use std::path::PathBuf;

/// What can be wrong with the files of a capture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// A file that is not what it should be.
    #[error("{}: {place}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, field or byte.
        place: String,
        /// What is wrong there and what would be right.
        problem: String,
    },
    /// A camera model that cannot be turned into a pinhole camera.
    #[error("{}: camera model {model} is not supported; undistort the photographs, or export one of {supported}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Its name, or its number.
        model: String,
        /// Those that are read.
        supported: &'static str,
    },
    /// A rotation that is none.
    #[error("{}: photograph {photograph}: {problem}; its pose cannot be used", path.display())]
    Rotation {
        /// The file.
        path: PathBuf,
        /// The photograph's name.
        photograph: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A photograph that a capture names and that is not there.
    #[error("{}: photograph {} is missing; copy it there, or remove its entry", path.display(), photograph.display())]
    Photograph {
        /// The file that names it.
        path: PathBuf,
        /// Where it should be.
        photograph: PathBuf,
    },
    /// Too few photographs with poses.
    #[error("{}: {found} photograph(s) with a pose; at least 2 are needed", path.display())]
    TooFew {
        /// The file.
        path: PathBuf,
        /// How many there are.
        found: usize,
    },
    /// All photographs taken from one place.
    #[error("{}: all photographs were taken from one place, so that nothing has parallax; add some from a little aside", path.display())]
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

/// Shorthand for results of the readers.
pub type Result<T, E = Error> = std::result::Result<T, E>;
