//! Ctrl-C and SIGTERM.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// The exit code of an interrupted program: 128 + SIGINT.
pub(crate) const EXIT_CODE: u8 = 130;
/// Time for the work to stop at its next callback; a prediction or a fusion has none.
const GRACE: Duration = Duration::from_secs(1);

static REQUESTED: AtomicBool = AtomicBool::new(false);
static TEMPORARY: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Installs the handler: a signal requests a stop, and ends the program soon after if the work continues.
pub(crate) fn install() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {
        REQUESTED.store(true, Ordering::SeqCst);
        thread::sleep(GRACE);
        // Held until the end: no folder is moved into place any more.
        let folder = temporary();
        if let Some(folder) = folder.as_ref() {
            let _ = std::fs::remove_dir_all(folder);
        }
        process::exit(EXIT_CODE.into());
    })
}

/// Whether a signal has arrived.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

/// The value that a callback returns.
pub(crate) fn flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Names the folder to be removed when a signal ends the program.
pub(crate) fn guard(folder: &Path) {
    *temporary() = Some(folder.to_owned());
}

/// The guarded folder; while this is held, a signal does not end the program.
pub(crate) fn temporary() -> MutexGuard<'static, Option<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(PoisonError::into_inner)
}
