/// What can be wrong with the input of a fusion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A view of another size than the prior, or than the first view.
    #[error("view {view} is {found:?} but {expected:?} ([height, width]) is needed; reproject it first")]
    Shape {
        /// Index of the view among the evidence.
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
    /// A value of the configuration out of range.
    #[error("{field} is {value}; {remedy}")]
    Config {
        /// The field, as the configuration file spells it.
        field: &'static str,
        /// The value at fault.
        value: f64,
        /// What to write instead.
        remedy: &'static str,
    },
    /// A sparse system that could not be solved.
    #[error("the system of the gradient posterior can't be solved ({0}); take a smaller image")]
    System(String),
    /// A depth map that [`GaussianDepth`](mde_uncertainty::GaussianDepth) refuses.
    #[error(transparent)]
    Map(#[from] mde_uncertainty::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
