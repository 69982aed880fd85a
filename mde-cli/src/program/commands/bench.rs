use crate::program::{BenchArgs, number, peak_memory, print};
use anyhow::{Context, Result, ensure};
use mde_eval::table::Table;
use mde_nerf::NerfConfig;
use mde_nerf::stages::{fields, multiply_adds, random_lines, stages};
use mde_uncertainty::statistics::median;
use serde::Serialize;
use serde_json::json;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Multiply-adds per measurement of the peak, about 0.1 ms.
const PEAK_ROUNDS: u64 = 1 << 16;
/// Size of the memory for the random reads, in `f32`: about that of a hash table.
const TABLE: usize = 1 << 21;
const LINES: u64 = 1 << 16;

#[derive(Serialize)]
struct Ceilings {
    /// Single-precision multiply-adds, counted as two operations.
    gflops_one_thread: f64,
    gflops_all_threads: f64,
    /// Random cache lines of an 8 MiB table, one thread.
    random_lines_gbytes_per_second: f64,
}

#[derive(Serialize)]
struct Row {
    field: &'static str,
    stage: &'static str,
    threads: usize,
    samples_per_second: f64,
    /// Of the matrix products, without padding.
    gflops: Option<f64>,
    share_of_peak: Option<f64>,
    gbytes_per_second: Option<f64>,
}

pub(super) fn run(args: &BenchArgs) -> Result<()> {
    ensure!(
        args.seconds > 0.0 && args.seconds <= 600.0,
        "--seconds {}: give a time above 0 and up to 600 seconds",
        args.seconds
    );
    let mut chosen = fields().to_vec();
    chosen.retain(|(name, _)| args.field.as_ref().is_none_or(|field| field == name));
    ensure!(
        !chosen.is_empty(),
        "--field {}: no such field; give one of {}",
        args.field.as_deref().unwrap_or_default(),
        fields().map(|(name, _)| name).join(", ")
    );
    let all =
        args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let ceilings = ceilings(args.seconds, all)?;
    let mut rows = Vec::new();
    for (name, field) in chosen {
        let config = NerfConfig { field, ..NerfConfig::default() };
        let counts = [(1, ceilings.gflops_one_thread), (all, ceilings.gflops_all_threads)];
        for (threads, peak) in counts.into_iter().take(if all > 1 { 2 } else { 1 }) {
            pool(threads)?.install(|| {
                stages(&config, &mut |stage, run| {
                    if stage.parallel || threads == 1 {
                        let once = median_seconds(args.seconds, run);
                        let rate = |count: u64| (count > 0).then(|| count as f64 / once * 1e-9);
                        rows.push(Row {
                            field: name,
                            stage: stage.name,
                            threads,
                            samples_per_second: stage.samples as f64 / once,
                            gflops: rate(stage.flops),
                            share_of_peak: rate(stage.flops).map(|gflops| gflops / peak),
                            gbytes_per_second: rate(stage.bytes),
                        });
                    }
                })
            })?;
        }
    }
    let memory = peak_memory();
    let text = match args.json {
        true => {
            let value =
                json!({ "threads": all, "ceilings": ceilings, "stages": rows, "peak_memory_bytes": memory });
            format!("{value:#}\n")
        }
        false => lines(all, &ceilings, &rows, memory),
    };
    print(text.as_bytes())
}

fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .with_context(|| format!("can't start {threads} threads; give fewer with --threads"))
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
    let memory = vec![1.0; TABLE];
    let (bytes, _) = random_lines(&memory, LINES);
    let fetch = median_seconds(seconds, || {
        black_box(random_lines(black_box(&memory), LINES));
    });
    Ok(Ceilings {
        gflops_one_thread: operations as f64 / one * 1e-9,
        gflops_all_threads: (8 * operations * threads as u64) as f64 / every * 1e-9,
        random_lines_gbytes_per_second: bytes as f64 / fetch * 1e-9,
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

fn lines(threads: usize, ceilings: &Ceilings, rows: &[Row], memory: Option<u64>) -> String {
    let Ceilings { gflops_one_thread, gflops_all_threads, random_lines_gbytes_per_second } = ceilings;
    let rows = rows.iter().map(|row| {
        vec![
            row.field.to_owned(),
            row.stage.to_owned(),
            row.threads.to_string(),
            format!("{:.2}", row.samples_per_second * 1e-6),
            number(row.gflops, 0),
            number(row.share_of_peak.map(|share| 100.0 * share), 0),
            number(row.gbytes_per_second, 0),
        ]
    });
    let heads = ["field", "stage", "threads", "Msamples/s", "GFLOP/s", "of peak, %", "GB/s"];
    let memory = memory.map(|bytes| bytes as f64 / f64::from(1 << 20));
    format!(
        "peak: {gflops_one_thread:.0} GFLOP/s on one thread, {gflops_all_threads:.0} on {threads}; random lines of 8 MiB: \
         {random_lines_gbytes_per_second:.0} GB/s on one thread\n\n{}\n\npeak memory: {} MiB\n",
        Table::new(2, heads, rows).text(),
        number(memory, 0)
    )
}
