//! Errors of the package: one line, as those of the crates.

use mde_cli::error::named;
use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    mdenerf,
    Error,
    PyValueError,
    "An input, a setting or a stage at fault. The message is one line that names it and the remedy."
);

/// A text of the library with the arguments that it names in braces as those of the package.
pub(crate) fn keywords(text: &str) -> String {
    named(text, |argument| argument.replace('-', "_"))
}

/// The message of an error in one line.
pub(crate) fn message(error: impl std::fmt::Display) -> String {
    keywords(&error.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// The Python exception of an error.
pub(crate) fn raise(error: impl std::fmt::Display) -> PyErr {
    Error::new_err(message(error))
}
