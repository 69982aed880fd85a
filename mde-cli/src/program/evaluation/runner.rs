//! Runs the methods whose results are not stored yet, and stores them. A scene that fails does not stop the others.

use crate::config::{Config, Preset};
use crate::error::Error;
use crate::prior::OpenPrior;
use crate::program::evaluation::fields::FieldMemory;
use crate::program::evaluation::method::{Interruptible, Method, MethodScene, PRIOR};
use crate::program::evaluation::scenes::{PriorPlan, fingerprint};
use crate::program::evaluation::setup::SceneLimit;
use crate::program::evaluation::store::{Found, Kept, Store};
use crate::program::interrupt;
use crate::program::progress::Progress;
use crate::refiner::{Refiner, Settings};
use crate::scene::camera::{CameraSource, KnownCamera};
use crate::scene::size::Sizes;
use crate::scene::{Photograph, Scene};
use anyhow::{Result, bail};
use mde_eval::capture::CapturedView;
use mde_eval::data::{DataSet, Sample};
use mde_eval::{Refined, Task, TaskView};
use mde_prior::DisparityRule;
use mde_prior::resample::nearest;
use mde_warp::{PinholeCamera, Pose};
use ndarray::{Array2, Array3};
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The scenes and methods to run.
pub(crate) struct Plan<'p> {
    pub(crate) data: &'p (dyn DataSet + Sync),
    /// Indices into the data set.
    pub(crate) scenes: &'p [usize],
    /// The prior first.
    pub(crate) methods: &'p [Method],
    pub(crate) prior: &'p PriorPlan,
    /// [`PriorPlan::describe`] of `prior`.
    pub(crate) prior_settings: Value,
    pub(crate) rule: DisparityRule,
    pub(crate) store: &'p Store,
    /// Memory limit of the scenes, and how many run at once.
    pub(crate) limit: SceneLimit,
    /// Whether the methods of a scene share fields of equal settings and views.
    pub(crate) share_fields: bool,
    /// Whether methods get the further photographs without their poses.
    pub(crate) without_poses: bool,
    /// Cameras of several photographs with this field of view, degrees, in place of their own.
    pub(crate) assumed_fov: Option<f64>,
}

/// A scene with the results of the methods that did not fail.
pub(crate) struct SceneResult<'r> {
    pub(crate) sample: &'r Sample,
    pub(crate) entries: Vec<(&'r Method, Kept)>,
}

/// An error of a scene or of one of its methods.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Failure {
    pub(crate) scene: String,
    /// `None` if the scene itself could not be loaded.
    pub(crate) method: Option<String>,
    pub(crate) error: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.method {
            Some(method) => write!(f, "{} {method}: {}", self.scene, self.error),
            None => write!(f, "{}: {}", self.scene, self.error),
        }
    }
}

/// Called by a worker for each finished scene.
type Finish<'f, T> = dyn Fn(&SceneResult<'_>) -> Result<T> + Sync + 'f;

/// Runs the plan. The results of `finish`, one per scene, are in the order of the data set.
pub(crate) fn run<T: Send>(
    plan: &Plan<'_>,
    progress: &mut Progress,
    finish: &Finish<'_, T>,
) -> Result<(Vec<T>, Vec<Failure>)> {
    let shared = Shared {
        plan,
        next: AtomicUsize::new(0),
        tally: Mutex::new(Tally::new(plan, progress)),
        failures: Mutex::default(),
    };
    let threads = (rayon::current_num_threads() / plan.limit.jobs).max(1);
    let mut results = Vec::new();
    let outcomes: Vec<Result<Vec<(usize, T)>>> = std::thread::scope(|scope| {
        let work = || -> Result<Vec<(usize, T)>> {
            // Where the system has no thread left for a pool of its own, the program's common one.
            match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
                Ok(pool) => pool.install(|| shared.work(finish)),
                Err(_) => shared.work(finish),
            }
        };
        let start = |_| std::thread::Builder::new().spawn_scoped(scope, work);
        let workers: Vec<_> = (0..plan.limit.jobs).map_while(|job| start(job).ok()).collect();
        if workers.is_empty() {
            // The system has no thread left: this one does the work.
            return vec![shared.work(finish)];
        }
        let joined = workers.into_iter().map(|worker| worker.join());
        joined.map(|outcome| outcome.unwrap_or_else(|_| bail!("a worker thread panicked"))).collect()
    });
    for outcome in outcomes {
        results.extend(outcome?);
    }
    if interrupt::requested() {
        bail!(Error::Interrupted);
    }
    results.sort_by_key(|(index, _)| *index);
    let mut failures = shared.failures.into_inner().unwrap_or_else(PoisonError::into_inner);
    failures.sort_by(|a, b| (&a.scene, &a.method).cmp(&(&b.scene, &b.method)));
    Ok((results.into_iter().map(|(_, result)| result).collect(), failures))
}

/// State shared by the workers.
struct Shared<'s> {
    plan: &'s Plan<'s>,
    next: AtomicUsize,
    tally: Mutex<Tally<'s>>,
    failures: Mutex<Vec<Failure>>,
}

impl Shared<'_> {
    fn work<T>(&self, finish: &Finish<'_, T>) -> Result<Vec<(usize, T)>> {
        let mut results = Vec::new();
        while !interrupt::requested() {
            let place = self.next.fetch_add(1, Ordering::SeqCst);
            let Some(&index) = self.plan.scenes.get(place) else { break };
            match self.scene(index, finish) {
                Ok(result) => results.push((index, result)),
                Err(_) if interrupt::requested() => break,
                Err(error) => self.fail(index, None, &error),
            }
        }
        Ok(results)
    }

    fn scene<T>(&self, index: usize, finish: &Finish<'_, T>) -> Result<T> {
        let mut sample = self.plan.data.load(index)?;
        if let Some(fov) = self.plan.assumed_fov {
            assume(&mut sample, fov)?;
        }
        self.plan.limit.check("its image", sample.depth.dim())?;
        if sample.assumed_camera {
            let warning = format!("{}: no intrinsics; the camera is assumed", sample.id);
            lock(&self.tally).progress.warn(warning);
        }
        let seed = self.plan.methods.first().map_or(0, |prior| prior.seed);
        let prior = self.plan.prior.open(&sample, seed)?;
        let (alone, photographs) = self.scenes(&sample)?;
        let view_priors = view_priors(&sample, &self.plan.rule)?;
        let views: Vec<TaskView<'_>> = sample
            .views
            .iter()
            .zip(&view_priors)
            .map(|(captured, prior)| TaskView {
                view: &captured.view,
                posed: !self.plan.without_poses,
                prior: prior.as_ref(),
            })
            .collect();
        let memory = self.plan.share_fields.then(FieldMemory::default);
        let own = self.plan.prior.made_from(&self.plan.prior_settings, &sample.id)?;
        let mut entries: Vec<(&Method, Kept)> = Vec::new();
        for method in self.plan.methods {
            let first = entries.first().map(|(_, prior)| &prior.refined.depth);
            // The prior that is made here depends on the seed.
            let seed = (sample.prior.is_none() && matches!(self.plan.prior, PriorPlan::Simulated))
                .then_some(method.seed);
            let made_from = json!({
                "input": fingerprint(&sample, first),
                "settings": match first {
                    Some(_) => method.settings(),
                    None => json!({ "prior": own, "rule": self.plan.rule, "seed": seed }),
                },
            });
            let outcome = match first {
                None => self.stored_or_run(&sample, method, made_from, || {
                    Ok(self.prior_depth(prior.open(), &alone)?.into())
                }),
                Some(depth) => self.stored_or_run(&sample, method, made_from, || {
                    let model = prior.open().prior();
                    let task = Task {
                        model: model.accepts_new_images().then_some(model),
                        views: &views,
                        focal_assumed: self.plan.assumed_fov.is_some(),
                        ..Task::new(sample.image.view(), &sample.camera, depth.view(), &self.plan.rule)
                    };
                    let scene = MethodScene {
                        id: &sample.id,
                        task,
                        prior: prior.open(),
                        alone: &alone,
                        photographs: &photographs,
                        memory: self.plan.limit.limit,
                    };
                    method.run(&scene, memory.as_ref())
                }),
            };
            match outcome {
                Ok(entry) => entries.push((method, entry)),
                Err(error) if interrupt::requested() || method.name == PRIOR => return Err(error),
                Err(error) => self.fail(index, Some(method), &error),
            }
        }
        finish(&SceneResult { sample: &sample, entries })
    }

    /// The reference alone, and with the further photographs.
    fn scenes(&self, sample: &Sample) -> Result<(Scene, Scene)> {
        let source = match self.plan.assumed_fov {
            Some(degrees) => CameraSource::Assumed(degrees),
            None => CameraSource::Scene,
        };
        let sizes = Sizes::default();
        let photograph = |name: String, image: &Array3<f32>, camera: &PinholeCamera, several| {
            let camera = KnownCamera { camera: *camera, source: source.clone() };
            Photograph::new(name, image.clone(), camera).resized(&sizes, several, &mut |_| ())
        };
        let reference = |several| photograph("0".to_owned(), &sample.image, &sample.camera, several);
        let alone = Scene::one(reference(false)?);
        if sample.views.is_empty() {
            return Ok((alone.clone(), alone));
        }
        let pose = |pose| (!self.plan.without_poses).then_some(pose);
        let mut photographs = vec![Photograph { pose: pose(Pose::identity()), ..reference(true)? }];
        for (captured, index) in sample.views.iter().zip(1..) {
            let view = &captured.view;
            let mut one = photograph(index.to_string(), &view.image, &view.camera, true)?;
            one.pose = pose(view.pose);
            one.mask = nearest(view.mask.view(), one.size());
            photographs.push(one);
        }
        Ok((alone, Scene::several(photographs, 0)?))
    }

    /// The prior's depth, of the photograph's size.
    fn prior_depth(&self, prior: &OpenPrior<'_>, scene: &Scene) -> Result<Array2<f32>> {
        let config = Config { disparity: self.plan.rule.clone(), ..Preset::Default.config() };
        let settings = Settings { config, memory: self.plan.limit.limit, ..Settings::new(Preset::Default) };
        let refiner = Refiner::new(prior, settings)?;
        let photograph = &scene.photographs[0];
        let plan = refiner.plan(&photograph.name, photograph.original, 1)?;
        let depth = refiner.prepare(scene, &plan, &mut Interruptible)?.prior_depth()?;
        Ok(depth)
    }

    /// The stored result if it was computed from the same inputs; otherwise runs the method and stores its result.
    fn stored_or_run(
        &self,
        sample: &Sample,
        method: &Method,
        made_from: Value,
        run: impl FnOnce() -> Result<Refined>,
    ) -> Result<Kept> {
        match self.plan.store.find(&sample.id, &method.name, &made_from)? {
            Found::Done(entry) => {
                lock(&self.tally).done += 1;
                return Ok(*entry);
            }
            Found::Stale(change) => {
                let warning = format!("{} {}: computed again, since {change}", sample.id, method.name);
                lock(&self.tally).progress.warn(warning);
            }
            Found::Nothing => {}
        }
        let start = Instant::now();
        let refined = run()?;
        if refined.depth.dim() != sample.depth.dim() {
            bail!("{}: its map differs in size from the image", method.name);
        }
        let seconds = start.elapsed().as_secs_f64();
        let entry = Kept { refined, made_from, seconds };
        self.plan.store.keep(&sample.id, &method.name, &entry)?;
        lock(&self.tally).done(&sample.id, &method.name, seconds);
        Ok(entry)
    }

    fn fail(&self, index: usize, method: Option<&Method>, error: &anyhow::Error) {
        let scene = self.plan.data.ids().get(index).cloned().unwrap_or_default();
        let method = method.map(|method| method.name.clone());
        let error = format!("{error:#}");
        let mut tally = lock(&self.tally);
        let what = method.as_deref().unwrap_or("scene");
        tally.progress.failed(format!("{scene} {what}: failed: {error}"));
        tally.done += if method.is_some() { 1 } else { self.plan.methods.len() };
        lock(&self.failures).push(Failure { scene, method, error });
    }
}

/// The monocular depths of the further photographs, where the data set has them.
fn view_priors(sample: &Sample, rule: &DisparityRule) -> Result<Vec<Option<Array2<f32>>>> {
    let depth =
        |captured: &CapturedView| captured.prior.as_ref().map(|prior| prior.to_depth(rule)).transpose();
    Ok(sample.views.iter().map(depth).collect::<Result<_, _>>()?)
}

/// Cameras of a field of view, the principal point in the middle.
fn assume(sample: &mut Sample, fov: f64) -> Result<()> {
    let assumed = |camera: &PinholeCamera| PinholeCamera::from_fov(fov, camera.width, camera.height);
    sample.camera = assumed(&sample.camera)?;
    for captured in &mut sample.views {
        captured.view.camera = assumed(&captured.view.camera)?;
    }
    Ok(())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Progress over all runs.
struct Tally<'t> {
    progress: &'t mut Progress,
    jobs: usize,
    done: usize,
    all: usize,
    /// Runs that were made now, and their seconds.
    made: (usize, f64),
}

impl<'t> Tally<'t> {
    fn new(plan: &Plan<'_>, progress: &'t mut Progress) -> Self {
        let all = plan.scenes.len() * plan.methods.len();
        Self { progress, jobs: plan.limit.jobs, done: 0, all, made: (0, 0.0) }
    }

    fn done(&mut self, scene: &str, method: &str, seconds: f64) {
        self.done += 1;
        self.made = (self.made.0 + 1, self.made.1 + seconds);
        let text = format!("{scene} {method}: {seconds:.1} s");
        let value = json!({ "event": "method", "scene": scene, "method": method, "method_seconds": seconds });
        let each = self.made.1 / self.made.0 as f64;
        let left = each * self.all.saturating_sub(self.done) as f64 / self.jobs as f64;
        self.progress.piece(self.done, self.all, &text, Some(left), value);
    }
}

/// Number of scenes to run at once: at most the number of scenes and of threads.
pub(crate) fn jobs(requested: usize, scenes: usize) -> usize {
    requested.min(scenes).min(rayon::current_num_threads()).max(1)
}
