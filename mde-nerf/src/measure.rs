//! Times of the stages of a fit beside what the machine can do.

use crate::config::{FieldConfig, NerfConfig};
use crate::stages::{multiply_adds, stages};
use crate::{Error, Result};
use mde_uncertainty::statistics::median;
use serde::Serialize;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Multiply-adds per measurement of the peak, about 0.1 ms.
const PEAK_ROUNDS: u64 = 1 << 16;

/// The most that was measured of plain loops.
#[derive(Debug, Serialize)]
pub struct Ceilings {
    /// Single-precision multiply-adds, counted as two operations.
    pub gflops_one_thread: f64,
    /// The same on all threads.
    pub gflops_all_threads: f64,
}

/// What was measured of a stage.
#[derive(Debug, Serialize)]
pub struct StageTimes {
    /// Name of the field.
    pub field: &'static str,
    /// Name of the stage.
    pub stage: &'static str,
    /// Threads that ran it.
    pub threads: usize,
    /// Samples per second.
    pub samples_per_second: f64,
    /// Of the matrix products, without padding.
    pub gflops: Option<f64>,
    /// Of the multiply-adds of that number of threads.
    pub share_of_peak: Option<f64>,
}

/// Measures the ceilings and the stages of these fields on one thread and on `threads`, each for about `seconds`.
///
/// # Errors
/// [`Error::External`] where the threads can't be started, and those of [`stages`].
pub fn measure(
    fields: &[(&'static str, FieldConfig)],
    threads: usize,
    seconds: f64,
) -> Result<(Ceilings, Vec<StageTimes>)> {
    let ceilings = ceilings(seconds, threads)?;
    let mut rows = Vec::new();
    for (name, field) in fields {
        let config = NerfConfig { field: field.clone(), ..NerfConfig::default() };
        let counts = [(1, ceilings.gflops_one_thread), (threads, ceilings.gflops_all_threads)];
        for (threads, peak) in counts.into_iter().take(if threads > 1 { 2 } else { 1 }) {
            pool(threads)?.install(|| {
                stages(&config, &mut |stage, run| {
                    if stage.parallel || threads == 1 {
                        let once = median_seconds(seconds, run);
                        let rate = |count: u64| (count > 0).then(|| count as f64 / once * 1e-9);
                        rows.push(StageTimes {
                            field: name,
                            stage: stage.name,
                            threads,
                            samples_per_second: stage.samples as f64 / once,
                            gflops: rate(stage.flops),
                            share_of_peak: rate(stage.flops).map(|gflops| gflops / peak),
                        });
                    }
                })
            })?;
        }
    }
    Ok((ceilings, rows))
}

fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    let fault = |error| Error::External(format!("can't start {threads} threads: {error}").into());
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(fault)
}

fn ceilings(seconds: f64, threads: usize) -> Result<Ceilings> {
    let (operations, _) = multiply_adds(PEAK_ROUNDS);
    let one = median_seconds(seconds, || {
        black_box(multiply_adds(black_box(PEAK_ROUNDS)));
    });
    let pool = pool(threads)?;
    let every = median_seconds(seconds, || {
        pool.broadcast(|_| black_box(multiply_adds(black_box(8 * PEAK_ROUNDS))));
    });
    Ok(Ceilings {
        gflops_one_thread: operations as f64 / one * 1e-9,
        gflops_all_threads: (8 * operations * threads as u64) as f64 / every * 1e-9,
    })
}

/// Median seconds of one call, over calls that together last about `seconds`.
fn median_seconds(seconds: f64, mut call: impl FnMut()) -> f64 {
    let start = Instant::now();
    call();
    // Short calls are timed several at a time.
    let calls = (1e-3 / start.elapsed().as_secs_f64().max(1e-9)).clamp(1.0, 1e4) as u32;
    let mut times = Vec::new();
    let begin = Instant::now();
    while times.len() < 3 || begin.elapsed() < Duration::from_secs_f64(seconds) {
        let start = Instant::now();
        (0..calls).for_each(|_| call());
        times.push(start.elapsed().as_secs_f64() / f64::from(calls));
    }
    median(times).unwrap_or(f64::NAN)
}
