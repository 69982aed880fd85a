//! `mde ablate`.

use crate::args::AblateArgs;
use crate::evaluation::ablation::{self, FULL};
use crate::evaluation::method::{Method, PRIOR};
use crate::evaluation::results::{self, Results};
use crate::evaluation::runner::{self, Plan};
use crate::evaluation::scenes::{PriorPlan, Source, choose};
use crate::evaluation::scoring::Scoring;
use crate::evaluation::store::Store;
use crate::job::use_threads;
use crate::progress::Progress;
use anyhow::{Result, ensure};
use mde_cli::Config;
use mde_eval::statistics::Bootstrap;
use mde_eval::table::Summary;
use serde_json::json;

pub(super) fn run(args: &AblateArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let methods = methods(args)?;
    let source = Source::open(&args.root, &args.data)?;
    let scenes = choose(&*source.data, &args.data.scenes, args.data.limit)?;
    let prior = PriorPlan::new(&args.prior, source.kind)?;
    let scoring = Scoring::new(&args.score, false);
    let basis = json!({ "command": "ablate", "data": source.describe() });
    let store = Store::open(&args.run.output, &basis, args.run.force)?;
    let plan = Plan {
        data: &*source.data,
        scenes: &scenes,
        methods: &methods,
        prior_settings: prior.describe()?,
        prior: &prior,
        rule: mde_prior::DisparityRule::default(),
        store: &store,
        jobs: runner::jobs(args.many.jobs.map(usize::from), scenes.len()),
        share_fields: true,
    };
    let (entries, failures) = runner::run(&plan, &mut progress, &|scene| scoring.scene(scene, &store))?;
    let mut entries: Vec<_> = entries.into_iter().flatten().collect();
    // A row that took its field from another would look cheap.
    entries.iter_mut().for_each(|entry| entry.seconds = None);
    ensure!(!entries.is_empty(), "no scene could be scored; see the warnings");
    let compared = |with| Summary::new(&entries, Some(with), &Bootstrap::default());
    let preface = ablation::table(&compared(FULL)?, &compared(PRIOR)?);
    let results = Results {
        title: format!("Ablation: {} with {}", source.title(), prior.title()),
        alignment: scoring.alignment_note(),
        preface,
        reference: Some(FULL.to_owned()),
        entries,
        failures,
        record: json!({ "data": source.describe(), "root": args.root, "prior": plan.prior_settings, "score": scoring.config,
                        "seeds": args.seeds, "preset": mde_cli::Preset::from(args.preset).name(), "config": base(args)? }),
    };
    results::finish(results, store.root(), &mut progress)
}

fn base(args: &AblateArgs) -> Result<Config> {
    let preset = args.preset.into();
    Ok(match &args.config {
        Some(path) => Config::from_file(preset, path)?,
        None => ablation::base(preset),
    })
}

/// The prior, then every row with every seed.
fn methods(args: &AblateArgs) -> Result<Vec<Method>> {
    let base = base(args)?;
    let known: Vec<&str> = ablation::rows(&base).map(|row| row.name).collect();
    for name in &args.rows {
        ensure!(
            known.contains(&name.as_str()),
            "--rows {name}: there is no such row; use some of {}",
            known.join(", ")
        );
    }
    let mut methods = vec![Method::parse(PRIOR, args.preset.into(), Some(base.seed))?];
    for seed in (0..u64::from(args.seeds)).map(|more| base.seed + more) {
        for row in ablation::rows(&base) {
            let wanted =
                args.rows.is_empty() || row.name == FULL || args.rows.iter().any(|name| name == row.name);
            if wanted {
                methods.push(Method::variant(row.name, row.config(&base), row.control, seed));
            }
        }
    }
    Ok(methods)
}
