//! Errors of the package: one line, as those of the crates.

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    mdenerf,
    Error,
    PyValueError,
    "An input, a setting or a stage at fault. The message is one line that names it and the remedy."
);

/// The message of an error in one line.
pub(crate) fn message(error: impl std::fmt::Display) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The Python exception of an error.
pub(crate) fn raise(error: impl std::fmt::Display) -> PyErr {
    Error::new_err(message(error))
}
