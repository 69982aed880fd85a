//! The common part of `mde eval`, `mde ablate` and `mde calibrate`: opens the inputs, runs the methods, collects the scores.

use crate::program::args::shard::Shard;
use crate::program::args::{CaptureArgs, EvaluationArgs, PixelArgs};
use crate::program::evaluation::method::Method;
use crate::program::evaluation::results::Results;
use crate::program::evaluation::runner;
use crate::program::evaluation::runner::{Failure, Plan};
use crate::program::evaluation::scenes::{PriorPlan, Source, choose};
use crate::program::evaluation::scoring::Scoring;
use crate::program::evaluation::store::Store;
use crate::program::open::settings;
use crate::program::progress::Progress;
use crate::refiner::plan::SceneMemory;
use crate::refiner::plan::limit::MemoryLimit;
use anyhow::{Result, ensure};
use mde_eval::table::Entry;
use mde_prior::DisparityRule;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The methods of a command and how they are scored.
pub(crate) struct Request<'a> {
    pub(crate) command: &'a str,
    /// The prior first.
    pub(crate) methods: &'a [Method],
    /// As in [`Scoring`].
    pub(crate) controls: bool,
    /// As in [`Plan`].
    pub(crate) share_fields: bool,
    /// Only this part of the scenes.
    pub(crate) shard: Option<Shard>,
    pub(crate) several: CaptureArgs,
    pub(crate) pixels: PixelArgs,
}

impl<'a> Request<'a> {
    /// Of one photograph a scene, scored with the controls.
    pub(crate) fn new(command: &'a str, methods: &'a [Method]) -> Self {
        let (several, pixels) = (CaptureArgs::default(), PixelArgs::default());
        Self { command, methods, controls: true, share_fields: false, shard: None, several, pixels }
    }
}

/// An evaluation with its inputs opened.
pub(crate) struct Setup<'a> {
    args: &'a EvaluationArgs,
    request: Request<'a>,
    memory: SceneMemory,
    pub(crate) source: Source,
    pub(crate) scenes: Vec<usize>,
    /// Number of the scenes of all shards.
    pub(crate) all: usize,
    pub(crate) prior: PriorPlan,
    prior_settings: Value,
    pub(crate) scoring: Scoring,
    pub(crate) store: Store,
}

impl<'a> Setup<'a> {
    /// Opens the inputs. A run that would need too much memory is refused before anything is written.
    pub(crate) fn open(args: &'a EvaluationArgs, request: Request<'a>) -> Result<Self> {
        let source = Source::open(args.root.as_deref(), &args.data, &request.several)?;
        let mut scenes = choose(&*source.data, &args.data.scenes, args.data.limit)?;
        let all = scenes.len();
        if let Some(shard) = &request.shard {
            ensure!(
                !args.run.force,
                "--force: would remove the scenes of the other shards; remove the folder first, or leave it out"
            );
            let ids = source.data.ids();
            scenes.retain(|&index| ids.get(index).is_some_and(|name| shard.has(name)));
        }
        let configs: Vec<_> = request.methods.iter().map(|method| method.config().cloned()).collect();
        let memory = SceneMemory::new(&configs, request.share_fields);
        let limit = limit(args, memory, &scenes);
        if let Some([width, height]) = args.data.size {
            limit.check("--size", (height, width))?;
        }
        let prior = PriorPlan::new(&args.prior, source.kind)?;
        let prior_settings = prior.describe();
        let scoring = Scoring::new(args.alignment.alignment, request.pixels, request.controls);
        let basis = json!({ "command": request.command, "data": source.describe() });
        let name = args.root.clone().unwrap_or_else(|| source.kind.name().into());
        let output = args.run.output(&name, &format!("-{}", request.command));
        let store = Store::open(&output, &basis, args.run.force, request.shard.is_some())?;
        Ok(Self { args, request, memory, source, scenes, all, prior, prior_settings, scoring, store })
    }

    /// Runs and scores the methods; stored results are reused.
    pub(crate) fn run(&self, progress: &mut Progress) -> Result<(Vec<Entry>, Vec<Failure>)> {
        let data = &*self.source.data;
        let plan = Plan {
            data,
            scenes: &self.scenes,
            methods: self.request.methods,
            prior: &self.prior,
            prior_settings: self.prior_settings.clone(),
            rule: DisparityRule::default(),
            store: &self.store,
            limit: limit(self.args, self.memory, &self.scenes),
            share_fields: self.request.share_fields,
            without_poses: self.source.withheld.is_some(),
            assumed_fov: self.source.assumed_fov(),
        };
        let (entries, failures) =
            runner::run(&plan, progress, &|scene| self.scoring.scene(scene, &self.store))?;
        let mut entries: Vec<Entry> = entries.into_iter().flatten().collect();
        let places: BTreeMap<&str, Option<&str>> = self
            .scenes
            .iter()
            .filter_map(|&index| Some((data.ids().get(index)?.as_str(), data.place(index))))
            .collect();
        for entry in &mut entries {
            // Not from the stored scores: --places may differ from that of an earlier run.
            entry.place = places.get(entry.scene.as_str()).copied().flatten().map(str::to_owned);
        }
        Ok((entries, failures))
    }

    /// The results, compared with `reference`.
    pub(crate) fn results(&self, reference: &str, entries: Vec<Entry>, failures: Vec<Failure>) -> Results {
        Results {
            title: format!("{} with {}", self.source.title(), self.prior.title()),
            alignment: self.scoring.alignment_note(),
            preface: Vec::new(),
            reference: Some(reference.to_owned()),
            entries,
            failures,
            record: json!({ "data": self.source.describe(), "root": self.args.root.as_ref().map(|root| root.display().to_string()), "prior": self.prior_settings,
                            "score": self.scoring.config }),
        }
    }
}

fn limit(args: &EvaluationArgs, memory: SceneMemory, scenes: &[usize]) -> SceneLimit {
    let jobs = runner::jobs(args.jobs.into(), scenes.len());
    SceneLimit { limit: settings::limit(&args.memory), memory, jobs }
}

/// The memory limit of an evaluation's scenes.
pub(crate) struct SceneLimit {
    pub(crate) limit: MemoryLimit,
    memory: SceneMemory,
    /// Scenes at once.
    pub(crate) jobs: usize,
}

impl SceneLimit {
    /// Refuses scenes of that size where those that run at once exceed the limit.
    pub(crate) fn check(&self, what: &str, size: (usize, usize)) -> Result<()> {
        let (with, jobs) = match self.jobs {
            1 => ("with these methods".to_owned(), ""),
            jobs => (format!("with these methods, {jobs} scenes at once,"), ", fewer --jobs"),
        };
        let bytes = |pixels| self.memory.bytes(pixels, self.jobs as u64);
        let remedy = |fits| match fits {
            Some((height, width)) => format!("give --size {width}x{height}, fewer views{jobs}"),
            None => format!("give fewer methods, fewer views or a smaller field{jobs}"),
        };
        Ok(self.limit.check_with(what, size, &with, bytes, remedy)?)
    }
}
