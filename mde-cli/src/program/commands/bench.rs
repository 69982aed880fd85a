use crate::program::{BenchArgs, number, peak_memory, print};
use anyhow::{Result, ensure};
use mde_eval::table::Table;
use mde_nerf::measure::{Ceilings, StageTimes, measure};
use mde_nerf::stages::fields;
use serde_json::json;

pub(super) fn run(args: &BenchArgs) -> Result<()> {
    let seconds = args.seconds;
    let sound = seconds > 0.0 && seconds <= 600.0;
    ensure!(sound, "--seconds {seconds}: give a time above 0 and up to 600 seconds");
    let all =
        args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let (ceilings, rows) = measure(&fields(), all, seconds)?;
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

fn lines(threads: usize, ceilings: &Ceilings, rows: &[StageTimes], memory: Option<u64>) -> String {
    let Ceilings { gflops_one_thread, gflops_all_threads } = ceilings;
    let rows = rows.iter().map(|row| {
        vec![
            row.field.to_owned(),
            row.stage.to_owned(),
            row.threads.to_string(),
            format!("{:.2}", row.samples_per_second * 1e-6),
            number(row.gflops, 0),
            number(row.share_of_peak.map(|share| 100.0 * share), 0),
        ]
    });
    let heads = ["field", "stage", "threads", "Msamples/s", "GFLOP/s", "of peak, %"];
    let memory = memory.map(|bytes| bytes as f64 / f64::from(1 << 20));
    format!(
        "peak: {gflops_one_thread:.0} GFLOP/s on one thread, {gflops_all_threads:.0} on {threads}\n\n{}\n\npeak memory: {} MiB\n",
        Table::new(2, heads, rows).text(),
        number(memory, 0)
    )
}
