//! `mde ablate`.

use crate::config::Config;
use crate::program::args::AblateArgs;
use crate::program::evaluation::ablation::FULL;
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::runner::{Evaluation, Request};
use crate::program::evaluation::{ablation, results};
use crate::program::open::settings::overridden;
use crate::program::progress::Progress;
use anyhow::{Result, ensure};
use mde_eval::statistics::Bootstrap;
use mde_eval::table::Summary;
use serde_json::json;

pub(super) fn run(args: &AblateArgs) -> Result<()> {
    let mut progress = Progress::start(&args.common.run)?;
    let base = overridden(args.preset, &args.config)?;
    let methods = methods(args, &base)?;
    let request = Request { command: "ablate", methods: &methods, share_fields: true, ..Request::default() };
    let evaluation = Evaluation::open(&args.common, request)?;
    let (mut entries, failures) = evaluation.run(&mut progress)?;
    // Rows share fields, so their seconds would mislead.
    for entry in &mut entries {
        entry.values.remove("seconds");
    }
    let preface = if entries.is_empty() {
        Vec::new()
    } else {
        let compared = |with| Summary::new(&entries, Some(with), &Bootstrap::default());
        ablation::table(&compared(FULL)?, &compared(PRIOR)?)
    };
    let mut results = evaluation.results(FULL, entries, failures);
    results.title.insert_str(0, "Ablation: ");
    results.preface = preface;
    results.record["seeds"] = json!(args.seeds);
    results.record["preset"] = json!(args.preset.name());
    results.record["config"] = json!(base);
    results::finish(results, &evaluation.store, &mut progress)
}

/// The prior, then every row with every seed.
fn methods(args: &AblateArgs, base: &Config) -> Result<Vec<Method>> {
    ensure!(
        base.refinement.fits_a_field(),
        "--preset {}: fits no field to a photograph, so all rows are equal; give --preset paper",
        args.preset.name()
    );
    let known: Vec<&str> = ablation::rows(base).map(|row| row.name).collect();
    for name in &args.rows {
        ensure!(
            known.contains(&name.as_str()),
            "--rows {name}: no such row; use some of {}",
            known.join(", ")
        );
    }
    let mut methods = vec![Method::parse(PRIOR, Some(base.seed))?];
    for seed in (0..u64::from(args.seeds)).map(|more| base.seed.wrapping_add(more)) {
        for row in ablation::rows(base) {
            let wanted =
                args.rows.is_empty() || row.name == FULL || args.rows.iter().any(|name| name == row.name);
            if wanted {
                methods.push(Method::variant(row.name, row.config(base), row.control(), seed));
            }
        }
    }
    Ok(methods)
}
