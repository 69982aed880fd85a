//! Work on a thread of its own. The calling thread has the interpreter: it runs the callables and checks for signals meanwhile.

use crate::error::{message, raise};
use mde_cli::mde_prior;
use ndarray::{Array2, Array3};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Longest time between two checks for signals.
const PATIENCE: Duration = Duration::from_millis(50);

/// What the work needs the interpreter for.
pub(crate) enum Request {
    /// Of a stage: its name, steps done, steps in all (0 where unknown).
    Progress(&'static str, usize, usize),
    /// A prediction for an image `[height, width, 3]`.
    Predict(Array3<f32>, Sender<Array2<f32>>),
}

/// The work's end of the connection.
pub(crate) struct Link {
    requests: Sender<Request>,
    cancelled: Arc<AtomicBool>,
}

impl Link {
    /// Whether the calling thread has given up.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    pub(crate) fn send(&self, request: Request) {
        // Without a receiver the work is cancelled.
        let _ = self.requests.send(request);
    }

    /// The prediction of the callable; nothing where it failed.
    pub(crate) fn predict(&self, image: Array3<f32>) -> mde_prior::Result<Array2<f32>> {
        let (reply, answer) = channel();
        self.send(Request::Predict(image, reply));
        answer.recv().map_err(|_| mde_prior::Error::Input("the model failed".to_owned()))
    }
}

/// Runs `work` on a thread of its own within the pool, without the GIL. `serve` runs here for each request; its error cancels the work
/// and is returned, and so is the exception of a signal.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    mut serve: impl FnMut(Request) -> PyResult<()>,
    work: impl FnOnce(&Link) -> Result<T, String> + Send,
) -> PyResult<T> {
    let pool = pool(threads)?;
    let (sender, requests) = channel();
    // Only to lend it to a closure.
    let requests = Mutex::new(requests);
    let cancelled = Arc::new(AtomicBool::new(false));
    let link = Link { requests: sender, cancelled: Arc::clone(&cancelled) };
    let mut failed = None;
    let outcome = std::thread::scope(|scope| {
        // The link ends with the work, a panic included, and with it the calling thread's wait.
        let worker = scope.spawn(move || pool.install(|| work(&link)));
        loop {
            let step = match py.detach(|| lock(&requests).recv_timeout(PATIENCE)) {
                Err(RecvTimeoutError::Disconnected) => break,
                // A reply that is dropped here ends the wait for it.
                _ if failed.is_some() => continue,
                Ok(request) => py.check_signals().and_then(|()| serve(request)),
                Err(RecvTimeoutError::Timeout) => py.check_signals(),
            };
            if let Err(error) = step {
                cancelled.store(true, Ordering::Relaxed);
                failed = Some(error);
            }
        }
        py.detach(|| worker.join())
    });
    if let Some(error) = failed {
        return Err(error);
    }
    match outcome {
        Ok(outcome) => outcome.map_err(raise),
        Err(panic) => {
            let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            Err(raise(format!("a fault of the package, please report it: {text}")))
        }
    }
}

/// A pool of threads, with the process that it is of.
type Pool = (u32, Option<usize>, Arc<ThreadPool>);

/// Those in use; few, as they are kept.
static POOLS: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

/// The pool of that many threads, by default one per core. A process that was forked has none of its parent's threads and gets pools
/// of its own.
pub(crate) fn pool(threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut pools = lock(&POOLS);
    if let Some((.., pool)) = pools.iter().find(|(of, size, _)| (*of, *size) == (process, threads)) {
        return Ok(Arc::clone(pool));
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|e| raise(format!("the threads can't be started ({}); give fewer threads", message(e))))?;
    let pool = Arc::new(pool);
    pools.push((process, threads, Arc::clone(&pool)));
    Ok(pool)
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
