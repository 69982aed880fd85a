//! `mde eval`.

use super::score_maps;
use crate::args::EvalArgs;
use crate::evaluation::method::{Method, PRIOR};
use crate::evaluation::results::{self, Results};
use crate::evaluation::runner::{self, Plan};
use crate::evaluation::scenes::{PriorPlan, Source, choose};
use crate::evaluation::scoring::Scoring;
use crate::evaluation::store::Store;
use crate::job::use_threads;
use crate::progress::Progress;
use anyhow::Result;
use serde_json::json;

pub(super) fn run(args: &EvalArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    if args.maps.pred.is_some() {
        return score_maps::run(args, &mut progress);
    }
    let source = Source::open(&args.root, &args.data)?;
    let scenes = choose(&*source.data, &args.data.scenes, args.data.limit)?;
    let methods = Method::parse_list(&args.methods, args.preset.into(), args.seed)?;
    let prior = PriorPlan::new(&args.prior, source.kind)?;
    let scoring = Scoring::new(&args.score, true);
    let basis = json!({ "command": "eval", "data": source.describe() });
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
        share_fields: false,
    };
    let (entries, failures) = runner::run(&plan, &mut progress, &|scene| scoring.scene(scene, &store))?;
    let results = Results {
        title: format!("{} with {}", source.title(), prior.title()),
        alignment: scoring.alignment_note(),
        preface: String::new(),
        reference: Some(PRIOR.to_owned()),
        entries: entries.into_iter().flatten().collect(),
        failures,
        record: json!({ "data": source.describe(), "root": args.root, "prior": plan.prior_settings, "score": scoring.config }),
    };
    results::finish(results, store.root(), &mut progress)
}
