use std::path::PathBuf;

/// Errors of fitting, rendering, saving and loading a field.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting out of its range.
    #[error(transparent)]
    Config(#[from] mde_uncertainty::OutOfRange),
    /// A view that cannot be used.
    #[error("view {index}: {reason}")]
    View {
        /// Index of the view.
        index: usize,
        /// The reason.
        reason: String,
    },
    /// No view, or no view with a valid pixel.
    #[error("nothing to fit: every view's mask is empty; give at least one view with valid pixels")]
    NoPixels,
    /// The depth range follows neither from a hypothesis nor from the configuration.
    #[error("unknown depth range; give view 0 a depth hypothesis, or set sampling.near and sampling.far")]
    NoRange,
    /// The field has to be fitted or loaded first.
    #[error("the field has not been fitted; call fit or load first")]
    NotFitted,
    /// The training loss is no longer finite.
    #[error("the fit diverged at step {step}; lower train.learning-rate")]
    Diverged {
        /// The first step whose loss is not finite.
        step: usize,
    },
    /// The callback returned [`ControlFlow::Break`](std::ops::ControlFlow::Break).
    #[error("interrupted")]
    Interrupted,
    /// A file that cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file that is not a saved field, or is damaged.
    #[error("{path} is not a usable field: {reason}")]
    Format {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A map that is not a valid Gaussian depth.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
    /// An error of a [`RadianceField`](crate::RadianceField) of another crate.
    #[error(transparent)]
    External(Box<dyn std::error::Error + Send + Sync>),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
