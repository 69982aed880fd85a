//! The memory that photographs in progress share.

use std::sync::{Condvar, Mutex, PoisonError};

/// A number of bytes, of which each holder takes a part.
pub(crate) struct Allowance {
    most: u64,
    used: Mutex<u64>,
    freed: Condvar,
}

/// A part of the allowance, given back when this is dropped.
pub(crate) struct Taken<'a> {
    from: &'a Allowance,
    bytes: u64,
}

impl Allowance {
    pub(crate) fn new(most: u64) -> Self {
        Self { most, used: Mutex::new(0), freed: Condvar::new() }
    }

    /// Waits until so many bytes are free; more than all of them wait until nothing else is taken.
    pub(crate) fn take(&self, bytes: u64) -> Taken<'_> {
        let bytes = bytes.min(self.most);
        let full = |used: &mut u64| *used > self.most - bytes;
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let mut used = self.freed.wait_while(used, full).unwrap_or_else(PoisonError::into_inner);
        *used += bytes;
        Taken { from: self, bytes }
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        *self.from.used.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.from.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn no_more_is_taken_at_once_than_there_is() {
        let (allowance, held, most) = (Allowance::new(10), AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for bytes in [3, 4, 5, 6, 10, 25] {
                let (allowance, held, most) = (&allowance, &held, &most);
                scope.spawn(move || {
                    for _ in 0..50 {
                        let taken = allowance.take(bytes);
                        most.fetch_max(
                            held.fetch_add(taken.bytes, Ordering::SeqCst) + taken.bytes,
                            Ordering::SeqCst,
                        );
                        std::thread::yield_now();
                        held.fetch_sub(taken.bytes, Ordering::SeqCst);
                    }
                });
            }
        });
        assert!((6..=10).contains(&most.load(Ordering::SeqCst)), "{most:?}");
        assert_eq!(*allowance.used.lock().unwrap(), 0);
    }
}
