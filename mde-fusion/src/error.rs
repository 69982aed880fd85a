/// What can be wrong with the input of a fusion, or with a fusion.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A view of another size than the prior, or than the first view.
    #[error("view {view} is {found:?} but {expected:?} ([height, width]) is needed; reproject it first")]
    Shape {
        /// Index of the view.
        view: usize,
        /// `[height, width]` that it should have.
        expected: [usize; 2],
        /// `[height, width]` that it has.
        found: [usize; 2],
    },
    /// A prior depth that is neither a positive number nor 0.
    #[error(
        "prior depth at row {row}, column {column} is {value}; it must be finite and > 0, or 0 where missing"
    )]
    Depth {
        /// Row of the pixel.
        row: usize,
        /// Column of the pixel.
        column: usize,
        /// The value at fault.
        value: f32,
    },
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] mde_uncertainty::OutOfRange),
    /// A depth map that [`GaussianDepth`](mde_uncertainty::GaussianDepth) refuses.
    #[error(transparent)]
    Map(#[from] mde_uncertainty::Error),
    /// The error of another implementation of [`Fuser`](crate::Fuser).
    #[error(transparent)]
    External(Box<dyn std::error::Error + Send + Sync>),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
