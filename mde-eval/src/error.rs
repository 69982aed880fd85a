use mde_uncertainty::OutOfRange;
use std::path::PathBuf;

/// What can go wrong when scoring, rendering or reading a data set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Two maps that must agree differ in shape.
    #[error("{what} is {found:?} but the truth is {expected:?} ([height, width]); resize one of them first")]
    Shape {
        /// The map at fault.
        what: &'static str,
        /// Its shape, `[height, width]`.
        found: [usize; 2],
        /// The shape it must have.
        expected: [usize; 2],
    },
    /// Two lists that must agree differ in length.
    #[error("{what} has {found} values where {expected} are needed; pass one value per pixel")]
    Length {
        /// The list at fault.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
    },
    /// Nothing is left to score.
    #[error("no pixel is left for {0}; check the depth range, the unit and the mask")]
    Empty(&'static str),
    /// A value that the metric is not defined for.
    #[error("{what} is {value} at index {index}; it must be {expected}")]
    Value {
        /// The quantity at fault.
        what: &'static str,
        /// Index into the list (row-major for a map).
        index: usize,
        /// The value at fault.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] OutOfRange),
    /// An unknown name.
    #[error("there is no {what} named `{name}`; use one of {known}")]
    Unknown {
        /// The kind of thing.
        what: &'static str,
        /// The name given.
        name: String,
        /// The names that exist.
        known: String,
    },
    /// A scene beyond the last one.
    #[error("scene {index} does not exist; the data set has {count}, counted from 0")]
    Scene {
        /// The index given.
        index: usize,
        /// How many scenes there are.
        count: usize,
    },
    /// A folder without the layout of the data set.
    #[error("{}: {reason}", path.display())]
    Layout {
        /// The file or folder at fault.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A file or folder that could not be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder at fault.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A method that runs the depth model on other images has only a depth map.
    #[error("this method runs the depth model on other images; name a model as the prior, not a file")]
    NoModel,
    /// A method that needs further photographs with poses, and has none.
    #[error("this method needs further photographs with poses; use a data set of captures")]
    NoViews,
    /// A method that failed.
    #[error("{0}")]
    Method(String),
    /// A list or a map that a statistic is not defined for.
    #[error(transparent)]
    Uncertainty(#[from] mde_uncertainty::Error),
    /// An invalid camera.
    #[cfg(feature = "prior")]
    #[error(transparent)]
    Camera(#[from] mde_warp::Error),
    /// Files of a capture that cannot be read or used.
    #[cfg(feature = "data")]
    #[error(transparent)]
    Capture(#[from] mde_mvs::capture::Error),
    /// A depth map, photograph or prior that cannot be read or used.
    #[cfg(feature = "prior")]
    #[error(transparent)]
    Prior(#[from] mde_prior::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A name, its values, whether a value is sound, and what it must be.
pub(crate) type List<'l> = (&'static str, &'l [f64], fn(f64) -> bool, &'static str);

/// Values that are positive and finite.
pub(crate) const fn positive<'l>(what: &'static str, values: &'l [f64]) -> List<'l> {
    (what, values, |v| v > 0.0 && v.is_finite(), "positive and finite")
}

/// Checks that lists are as long as the first and hold sound values, and that `empty` has at least one.
pub(crate) fn check_lists<const N: usize>(empty: &'static str, lists: [List<'_>; N]) -> Result<()> {
    let expected = lists.first().map_or(0, |list| list.1.len());
    for (what, values, sound, needed) in lists {
        if values.len() != expected {
            return Err(Error::Length { what, found: values.len(), expected });
        }
        if let Some(index) = values.iter().position(|value| !sound(*value)) {
            return Err(Error::Value { what, index, value: values[index], expected: needed });
        }
    }
    if expected == 0 { Err(Error::Empty(empty)) } else { Ok(()) }
}

/// [`Error::Config`] for the first setting that is not sound: name, value, whether it is sound, and what to do.
pub(crate) fn check<const N: usize>(settings: [(&'static str, f64, bool, &'static str); N]) -> Result<()> {
    for (field, value, sound, remedy) in settings {
        OutOfRange::check(sound, field, &value, remedy)?;
    }
    Ok(())
}
