//! Ctrl-C, SIGTERM, SIGHUP and SIGQUIT.

use crate::program::lock;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::thread;
use std::time::Duration;

/// The exit code of an interrupted program: 128 + SIGINT.
pub(crate) const EXIT_CODE: u8 = 130;
/// Time for the work to stop at its next callback; a prediction or a fusion has none.
const GRACE: Duration = Duration::from_secs(1);

static REQUESTED: AtomicBool = AtomicBool::new(false);
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Installs the handler: a signal requests a stop, and ends the program soon after if the work continues. Where the system has no
/// thread left for it, a signal ends the program at once. Called before any other thread is started.
pub(crate) fn install() {
    #[cfg(unix)]
    wait_for_quit();
    let _ = ctrlc::set_handler(end);
}

/// Requests a stop, and ends the program without its unfinished files after some time.
fn end() {
    REQUESTED.store(true, Ordering::SeqCst);
    thread::sleep(GRACE);
    // Held until the end: no folder is moved into place any more.
    let held = hold();
    for path in held.iter() {
        let _ = std::fs::remove_dir_all(path).or_else(|_| std::fs::remove_file(path));
    }
    process::exit(EXIT_CODE.into());
}

/// SIGQUIT, which `ctrlc` leaves out: all threads block it, as they inherit the mask of this one, and one waits for it.
#[cfg(unix)]
fn wait_for_quit() {
    use nix::sys::signal::{SigSet, Signal};
    let quit: SigSet = [Signal::SIGQUIT].into_iter().collect();
    if quit.thread_block().is_err() {
        return;
    }
    let wait = move || {
        if quit.wait().is_ok() {
            end();
        }
    };
    if thread::Builder::new().name("SIGQUIT".to_owned()).spawn(wait).is_err() {
        let _ = quit.thread_unblock();
    }
}

pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}

/// The value that a callback returns.
pub(crate) fn flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// A file or folder that is removed when a signal ends the program, until this is dropped.
pub(crate) struct Guard(PathBuf);

pub(crate) fn guard(path: &Path) -> Guard {
    hold().push(path.to_owned());
    Guard(path.to_owned())
}

impl Drop for Guard {
    fn drop(&mut self) {
        hold().retain(|path| *path != self.0);
    }
}

/// The guarded names; while this is held, a signal does not end the program.
pub(crate) fn hold() -> MutexGuard<'static, Vec<PathBuf>> {
    lock(&TEMPORARY)
}
