use std::fmt::Display;

/// What can be wrong with a depth map, a list of values, or a calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A map that must have the size of another.
    #[error("{what} is {found:?} but the map {expected:?} ([height, width]); give both one size")]
    Size {
        /// The map at fault.
        what: &'static str,
        /// Its shape, `[height, width]`.
        found: (usize, usize),
        /// The shape that it must have.
        expected: (usize, usize),
    },
    /// A mean that is not a finite number at a pixel of finite variance.
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
    /// Two lists that must agree differ in length.
    #[error("{what} has {found} values where {expected} are needed; give both lists the same length")]
    Length {
        /// The list at fault.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that it must have.
        expected: usize,
    },
    /// A value of a list that a statistic is not defined for.
    #[error("{what} is {value} at index {index}; {remedy}")]
    Value {
        /// The quantity at fault.
        what: &'static str,
        /// Index into the list.
        index: usize,
        /// The value at fault.
        value: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] OutOfRange),
    /// A text that is no calibration.
    #[error("{origin}: {reason}; calibrate again")]
    Calibration {
        /// The file that the text is from.
        origin: String,
        /// What is wrong with it, in one line.
        reason: String,
    },
}

/// A setting out of its range, as every crate of the workspace reports it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} is {value}; {remedy}")]
pub struct OutOfRange {
    /// The setting, as the configuration file spells it.
    pub field: &'static str,
    /// Its value.
    pub value: String,
    /// What to do.
    pub remedy: &'static str,
}

impl OutOfRange {
    /// Of a setting and its value.
    pub fn new(field: &'static str, value: impl Display, remedy: &'static str) -> Self {
        Self { field, value: value.to_string(), remedy }
    }

    /// Refuses a value that is not `sound`.
    ///
    /// # Errors
    /// The setting, its value and the remedy.
    pub fn check(
        sound: bool,
        field: &'static str,
        value: &dyn Display,
        remedy: &'static str,
    ) -> Result<(), Self> {
        if sound { Ok(()) } else { Err(Self::new(field, value, remedy)) }
    }
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
