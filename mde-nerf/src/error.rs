use std::path::PathBuf;

/// What can go wrong in fitting, rendering, saving or loading a field.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A configuration value out of range.
    #[error("{field} is {value}; {remedy}")]
    Config {
        /// The field's name, with its sections.
        field: &'static str,
        /// The value at fault.
        value: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A view that cannot be used.
    #[error("view {index}: {reason}")]
    View {
        /// Index of the view.
        index: usize,
        /// What is wrong with it.
        reason: String,
    },
    /// No view, or none with a pixel to train on.
    #[error("there is nothing to fit: no view has a pixel that may be trained on")]
    NoPixels,
    /// Neither a depth hypothesis nor a configured range says where the scene is.
    #[error(
        "the depth range is unknown: give view 0 a depth hypothesis, or set sampling.near and sampling.far"
    )]
    NoRange,
    /// The field was asked to render or save before it was fitted or loaded.
    #[error("the field has not been fitted; call fit or load first")]
    NotFitted,
    /// Training ended in numbers that are not finite.
    #[error("the fit diverged at step {step}; lower train.learning-rate")]
    Diverged {
        /// The step at which the loss stopped being finite.
        step: usize,
    },
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
    /// A file that cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that is no saved field, or a broken one.
    #[error("{path} is not a usable field: {reason}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A map that is no Gaussian depth.
    #[error(transparent)]
    Depth(#[from] mde_uncertainty::Error),
}

/// Shorthand for this crate's results.
pub type Result<T, E = Error> = std::result::Result<T, E>;
