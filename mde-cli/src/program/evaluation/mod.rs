//! Methods on many scenes, for `mde eval`, `mde ablate` and `mde calibrate`: opens the inputs, runs the methods whose results are not
//! stored yet, scores them, and goes on after a failure.

pub(crate) mod ablation;
mod method;
pub(crate) mod results;
mod scenes;
mod scoring;
mod store;

use method::MethodScene;
pub(crate) use method::{Method, PRIOR};
use results::Results;
use scenes::{Form, Priors, Source, choose, depth_file};
pub(crate) use scoring::Scoring;
use store::Kept;
pub(crate) use store::Store;

use crate::program::open::limit;
use crate::program::{
    CaptureArgs, EvaluationArgs, PixelArgs, Progress, caught, interrupt, lock, side_by_side,
};
use crate::refiner::{MemoryLimit, Observer, SceneMemory};
use crate::scene::{CameraSource, KnownCamera, Photograph, Scene, Sizes};
use anyhow::{Result, ensure};
use mde_eval::data::{Sample, Shard};
use mde_eval::field::FieldMemory;
use mde_eval::table::{Entry, Failure};
use mde_eval::{Refined, Task, TaskView};
use mde_prior::DisparityRule;
use mde_prior::resample::nearest;
use mde_warp::{PinholeCamera, Pose};
use ndarray::{ArcArray, Ix3};
use rayon::ThreadPoolBuilder;
use serde_json::{Value, json};
use std::sync::Mutex;
use std::time::Instant;

/// The methods of a command and how they are scored; by default of one photograph a scene, with the controls.
#[derive(Default)]
pub(crate) struct Request<'a> {
    pub(crate) command: &'a str,
    /// The prior first.
    pub(crate) methods: &'a [Method],
    /// Whether the methods of a scene share fields of equal settings and views, and are scored without controls.
    pub(crate) share_fields: bool,
    pub(crate) shard: Option<Shard>,
    pub(crate) several: CaptureArgs,
    pub(crate) pixels: PixelArgs,
}

/// An evaluation with its inputs opened.
pub(crate) struct Evaluation<'a> {
    args: &'a EvaluationArgs,
    request: Request<'a>,
    memory: SceneMemory,
    /// Scenes at once.
    jobs: usize,
    pub(crate) source: Source,
    /// Indices into the data set.
    pub(crate) scenes: Vec<usize>,
    /// Number of the scenes of all shards.
    pub(crate) all: usize,
    pub(crate) prior: Priors,
    pub(crate) scoring: Scoring,
    pub(crate) store: Store,
}

impl<'a> Evaluation<'a> {
    /// Opens the inputs. A run that would need too much memory is refused before anything is written.
    pub(crate) fn open(args: &'a EvaluationArgs, request: Request<'a>) -> Result<Self> {
        let source = Source::open(args.root.as_deref(), &args.data, &request.several)?;
        let ids = source.data.ids();
        let mut scenes = choose(ids, &args.data.scenes, args.data.limit)?;
        let all = scenes.len();
        if let Some(shard) = &request.shard {
            ensure!(
                !args.run.force,
                "--force: would remove the scenes of the other shards; remove the folder first, or leave it out"
            );
            scenes.retain(|&index| shard.has(&ids[index]));
        }
        let configs: Vec<_> = request.methods.iter().map(|method| method.config().cloned()).collect();
        let jobs = usize::from(args.jobs).min(scenes.len()).min(rayon::current_num_threads()).max(1);
        let memory = SceneMemory::new(&configs, request.share_fields);
        if let Some([width, height]) = args.data.size {
            check(&limit(&args.memory), &memory, jobs, "--size", (height, width))?;
        }
        let prior = Priors::open(&args.prior, source.kind)?;
        let scoring = Scoring::new(args.alignment, request.pixels, !request.share_fields);
        let basis = json!({ "command": request.command, "data": source.settings });
        let name = args.root.clone().unwrap_or_else(|| source.kind.to_string().into());
        let output = args.run.output(&name, &format!("-{}", request.command));
        let store = Store::open(&output, &basis, args.run.force, request.shard.is_some())?;
        Ok(Self { args, request, memory, jobs, source, scenes, all, prior, scoring, store })
    }

    /// Runs and scores the methods; stored results are reused. Scores are in the order of the data set.
    pub(crate) fn run(&self, progress: &mut Progress) -> Result<(Vec<Entry>, Vec<Failure>)> {
        let methods = self.request.methods.len();
        let (all, start, failures) = (self.scenes.len() * methods, Instant::now(), Vec::new());
        let tally = Mutex::new(Tally { progress, methods, done: 0, all, start, made: 0, failures });
        let threads = (rayon::current_num_threads() / self.jobs).max(1);
        let work = |place: usize| {
            let (index, tally) = (self.scenes[place], &tally);
            let scene = || caught(|| self.scene(index, tally));
            // Where the system has no thread left for a pool of its own, the program's common one.
            let entries = match ThreadPoolBuilder::new().num_threads(threads).build() {
                Ok(pool) => pool.install(scene),
                Err(_) => scene(),
            };
            entries.unwrap_or_else(|error| {
                lock(tally).fail(&self.source.data.ids()[index], None, &error);
                Vec::new()
            })
        };
        let entries = side_by_side(self.jobs, self.scenes.len(), work)?.concat();
        let mut failures = std::mem::take(&mut lock(&tally).failures);
        failures.sort();
        Ok((entries, failures))
    }

    pub(crate) fn results(&self, reference: &str, entries: Vec<Entry>, failures: Vec<Failure>) -> Results {
        Results {
            title: format!("{} with {}", self.source.title, self.prior.title),
            alignment: self.scoring.alignment_note(),
            preface: Vec::new(),
            reference: Some(reference.to_owned()),
            entries,
            failures,
            record: json!({ "data": self.source.settings, "root": self.args.root.as_ref().map(|root| root.display().to_string()),
                            "prior": self.prior.settings, "score": self.scoring.config }),
        }
    }

    fn scene(&self, index: usize, tally: &Mutex<Tally<'_>>) -> Result<Vec<Entry>> {
        let mut sample = self.source.data.load(index)?;
        let assumed_fov = self.source.assumed_fov;
        if let Some(fov) = assumed_fov {
            let views = sample.views.iter_mut().map(|captured| &mut captured.view.camera);
            for camera in views.chain([&mut sample.camera]) {
                *camera = PinholeCamera::from_fov(fov, camera.width, camera.height)?;
            }
        }
        let limit = limit(&self.args.memory);
        check(&limit, &self.memory, self.jobs, "its image", sample.depth.dim())?;
        if sample.assumed_camera {
            lock(tally).progress.warn(format!("{}: no intrinsics; the camera is assumed", sample.id));
        }
        let Some((first, others)) = self.request.methods.split_first() else { return Ok(Vec::new()) };
        let mut own = None;
        let prior = self.prior.of_scene(&sample, first.seed, &mut own)?;
        let posed = self.source.posed;
        let (alone, photographs) = scenes(&sample, assumed_fov, posed)?;
        let scene =
            MethodScene { id: &sample.id, prior, alone: &alone, photographs: &photographs, memory: limit };

        // What is simulated here depends on the seed.
        let simulated = sample.prior.is_none() && matches!(self.prior.form, Form::Simulated);
        let seed = simulated.then_some(first.seed);
        let rule = DisparityRule::default();
        let settings = json!({ "prior": self.prior.made_from(&sample.id)?, "rule": rule, "seed": seed });
        let made_from = json!({ "input": sample.fingerprint(None), "settings": settings });
        let run = || Ok(scene.prior_depth()?.into());
        let mut made = vec![(first, self.stored_or_run(&sample, first, made_from, run, tally)?)];

        let depth = made[0].1.refined.depth.clone();
        let own =
            sample.views.iter().map(|view| view.prior.as_ref().map(|own| own.to_depth(&rule)).transpose());
        let own = own.collect::<Result<Vec<_>, _>>()?;
        let views = sample.views.iter().zip(&own);
        let views = views.map(|(one, own)| TaskView { view: &one.view, posed, prior: own.as_ref() });
        let views: Vec<TaskView<'_>> = views.collect();
        let task = Task {
            model: prior.prior().accepts_new_images().then_some(prior.prior()),
            views: &views,
            focal_assumed: assumed_fov.is_some(),
            ..Task::new(sample.image.view(), &sample.camera, depth.view(), &rule)
        };
        let fields = self.request.share_fields.then(FieldMemory::default);
        let input = sample.fingerprint(Some(&depth));
        for method in others {
            let made_from = json!({ "input": input, "settings": method.settings() });
            let run = || method.run(&scene, &task, fields.as_ref());
            match self.stored_or_run(&sample, method, made_from, run, tally) {
                Ok(kept) => made.push((method, kept)),
                Err(error) if interrupt::requested() => return Err(error),
                Err(error) => lock(tally).fail(&sample.id, Some(method), &error),
            }
        }
        let mut entries = self.scoring.scene(&sample, &made, &self.store)?;
        // Not in the stored scores.
        let place = self.source.data.place(index).map(str::to_owned);
        entries.iter_mut().for_each(|entry| entry.place.clone_from(&place));
        Ok(entries)
    }

    /// The stored result if it was computed from the same inputs; otherwise runs the method and stores its result.
    fn stored_or_run(
        &self,
        sample: &Sample,
        method: &Method,
        made_from: Value,
        run: impl FnOnce() -> Result<Refined>,
        tally: &Mutex<Tally<'_>>,
    ) -> Result<Kept> {
        match self.store.find(&sample.id, &method.name, &made_from) {
            Ok(Some(kept)) => {
                lock(tally).done += 1;
                return Ok(kept);
            }
            Ok(None) => {}
            Err(reason) => {
                let warning = format!("{} {}: computed again, since {reason}", sample.id, method.name);
                lock(tally).progress.warn(warning);
            }
        }
        let start = Instant::now();
        let refined = run()?;
        let same = refined.depth.dim() == sample.depth.dim();
        ensure!(same, "{}: its map differs in size from the image", method.name);
        let kept = Kept { refined, made_from, seconds: start.elapsed().as_secs_f64() };
        self.store.keep(&sample.id, &method.name, &kept)?;
        lock(tally).done(&sample.id, &method.name, kept.seconds);
        Ok(kept)
    }
}

/// The reference alone, and with the further photographs, `posed` or not.
fn scenes(sample: &Sample, assumed_fov: Option<f64>, posed: bool) -> Result<(Scene, Scene)> {
    let source = assumed_fov.map_or(CameraSource::Scene, CameraSource::Assumed);
    let photograph = |name: String, image: ArcArray<f32, Ix3>, camera: &PinholeCamera, several| {
        let camera = KnownCamera { camera: *camera, source: source.clone() };
        Photograph::new(name, image, camera).resized(&Sizes::default(), several, &mut |_| ())
    };
    let reference = |several| photograph("0".to_owned(), sample.image.to_shared(), &sample.camera, several);
    let alone = Scene::one(reference(false)?);
    if sample.views.is_empty() {
        return Ok((alone.clone(), alone));
    }
    let mut photographs = vec![Photograph { pose: posed.then(Pose::identity), ..reference(true)? }];
    for (captured, index) in sample.views.iter().zip(1..) {
        let view = &captured.view;
        let mut one = photograph(index.to_string(), view.image.clone(), &view.camera, true)?;
        one.pose = posed.then_some(view.pose);
        one.mask = nearest(view.mask.view(), one.size()).into_shared();
        photographs.push(one);
    }
    Ok((alone, Scene::several(photographs)?))
}

/// Progress over all runs.
struct Tally<'t> {
    progress: &'t mut Progress,
    /// Of a scene.
    methods: usize,
    done: usize,
    all: usize,
    start: Instant,
    /// Runs that were made since.
    made: usize,
    failures: Vec<Failure>,
}

impl Tally<'_> {
    fn done(&mut self, scene: &str, method: &str, seconds: f64) {
        self.done += 1;
        self.made += 1;
        let text = format!("{scene} {method}: {seconds:.1} s");
        let value = json!({ "event": "method", "scene": scene, "method": method, "method_seconds": seconds });
        let each = self.start.elapsed().as_secs_f64() / self.made as f64;
        let left = each * self.all.saturating_sub(self.done) as f64;
        self.progress.piece(self.done, self.all, &text, Some(left), value);
    }

    /// A method of a scene failed, or all.
    fn fail(&mut self, scene: &str, method: Option<&Method>, error: &anyhow::Error) {
        if interrupt::requested() {
            return;
        }
        let (scene, error) = (scene.to_owned(), format!("{error:#}"));
        let method = method.map(|method| method.name.clone());
        let what = method.as_deref().unwrap_or("scene");
        self.progress.failed(format!("{scene} {what}: failed: {error}"));
        self.done += if method.is_some() { 1 } else { self.methods };
        self.failures.push(Failure { scene, method, error });
    }
}

/// Refuses scenes of that size where those that run at once exceed the limit.
fn check(
    limit: &MemoryLimit,
    memory: &SceneMemory,
    jobs: usize,
    what: &str,
    size: (usize, usize),
) -> Result<()> {
    let (with, fewer) = match jobs {
        1 => ("with these methods".to_owned(), ""),
        jobs => (format!("with these methods, {jobs} scenes at once,"), ", fewer --jobs"),
    };
    let remedy = |fits| match fits {
        Some((height, width)) => format!("give --size {width}x{height}, fewer views{fewer}"),
        None => format!("give fewer methods, fewer views or a smaller field{fewer}"),
    };
    Ok(limit.check_with(what, size, &with, |pixels| memory.bytes(pixels, jobs as u64), remedy)?)
}
