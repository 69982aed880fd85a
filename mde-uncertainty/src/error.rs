/// What can be wrong with a depth map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The two maps of a [`GaussianDepth`](crate::GaussianDepth) differ in shape.
    #[error("mean is {mean:?} but variance is {variance:?} ([height, width]); both must agree")]
    Shape {
        /// Shape of the mean, `[height, width]`.
        mean: [usize; 2],
        /// Shape of the variance, `[height, width]`.
        variance: [usize; 2],
    },
    /// A mean that is not a finite number where the variance says that something is known.
    #[error("mean at row {row}, column {column} is {value}; it must be finite where the variance is")]
    Mean {
        /// Row of the pixel.
        row: usize,
        /// Column of the pixel.
        column: usize,
        /// The value at fault.
        value: f32,
    },
    /// A variance that is NaN or negative.
    #[error(
        "variance at row {row}, column {column} is {value}; it must be >= 0, or infinite for a missing pixel"
    )]
    Variance {
        /// Row of the pixel.
        row: usize,
        /// Column of the pixel.
        column: usize,
        /// The value at fault.
        value: f32,
    },
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
