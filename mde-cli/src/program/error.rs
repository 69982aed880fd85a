//! Errors as the user sees them: one line, with arguments as flags.

use crate::error::{named, text};
use anyhow::Result;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Where the last panic began, and its message.
static PANIC: Mutex<String> = Mutex::new(String::new());

/// A part of the results is missing; the rest is written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Partial {
    /// Some photographs, scenes or methods failed.
    #[error("{failed} of the runs failed ({first}); the others are in {folder}")]
    Runs { failed: usize, first: String, folder: String },
    /// No further photograph was of use.
    #[error("{{views}}: {reason}; the depth in {folder} is that of the reference photograph alone")]
    Views { reason: String, folder: String },
}

/// The error of a run in whose `folder` some results are missing; none where nothing failed.
pub(crate) fn partial(failed: usize, first: Option<String>, folder: &Path) -> Result<()> {
    let folder = folder.display().to_string();
    first.map_or(Ok(()), |first| Err(Partial::Runs { failed, first, folder }.into()))
}

pub(crate) fn fault() -> MutexGuard<'static, String> {
    PANIC.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The error and its causes, without those that its text contains already.
pub(crate) fn message(error: &anyhow::Error) -> String {
    flags(&text(error.as_ref()))
}

/// A text of the library with the arguments that it names in braces as flags.
pub(crate) fn flags(text: &str) -> String {
    named(text, |argument| match argument {
        "keep-field" => "--export field".to_owned(),
        argument => format!("--{argument}"),
    })
}
