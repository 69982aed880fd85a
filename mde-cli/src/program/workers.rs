//! Work side by side, on threads of its own: a pool's thread that waits for memory could take up a task that waits for it.

use crate::error::Error;
use crate::program::{fault, interrupt};
use anyhow::{Result, anyhow, ensure};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, Builder};

/// The results of `work` for `0..count`, in this order, on at most so many threads; an error after a signal.
pub(crate) fn side_by_side<T: Send>(
    threads: usize,
    count: usize,
    work: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>> {
    let next = AtomicUsize::new(0);
    let made = Mutex::new((0..count).map(|_| None).collect::<Vec<Option<T>>>());
    let run = || {
        while !interrupt::requested() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                break;
            }
            let result = work(index);
            lock(&made)[index] = Some(result);
        }
    };
    thread::scope(|scope| {
        let spawn = |_: &usize| Builder::new().spawn_scoped(scope, run).is_ok();
        // A system without threads has this one.
        if (0..threads.min(count)).filter(spawn).count() == 0 {
            run();
        }
    });
    ensure!(!interrupt::requested(), Error::Interrupted);
    Ok(made.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().flatten().collect())
}

/// Does work whose panic is an error.
pub(crate) fn caught<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|_| Err(anyhow!("a fault of the program, please report it: {}", fault())))
}

/// Locks, also after a panic of another holder.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
