//! The loop as a [`mde_eval::Method`], beside the baselines of `mde-eval`.

use crate::program::evaluation::filtered::FilteredField;
use crate::several::{Capture, Photograph, refine_capture};
use crate::config::Config;
use crate::error::Error;
use crate::refinement::event::Event;
use crate::refinement::stages::Stages;
use crate::refinement::refine;
use mde_eval::{Method, Refined, Task};
use mde_nerf::{FieldCallback, FitReport, Nerf, NerfConfig, RadianceField, RenderConfig, RenderedView};
use mde_prior::{DepthKind, DepthPrior, PriorDepth};
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, ArrayView3};
use serde_json::json;
use std::collections::HashMap;
use std::collections::hash_map::{DefaultHasher, Entry};
use std::hash::{Hash, Hasher};
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Progress callback, called from any thread; `Break` cancels.
pub(crate) type SharedCallback<'o> = dyn Fn(&Event) -> ControlFlow<()> + Sync + 'o;

/// [`refine`] with the settings of one [`Config`] and the seed of the [`Task`].
///
/// The report of a [`Refined`] has the `iterations`, one [`IterationReport`](crate::reports::iteration::IterationReport) each.
pub(crate) struct LoopRefiner<'o> {
    config: Config,
    memory: Option<FieldMemory>,
    control: Option<Arc<dyn Method + Send + Sync>>,
    callback: &'o SharedCallback<'o>,
    photographs: bool,
}

impl<'o> LoopRefiner<'o> {
    /// The loop with these settings.
    pub(crate) fn new(config: Config, callback: &'o SharedCallback<'o>) -> Self {
        Self { config, memory: None, control: None, callback, photographs: false }
    }

    /// Uses the further photographs of a task, as [`refine_capture`] does. Without any, the photograph alone is refined.
    #[must_use]
    pub(crate) fn with_photographs(mut self) -> Self {
        self.photographs = true;
        self
    }

    /// Reuses the fields of the first iteration: configurations that differ only in the fusion share them.
    #[must_use]
    pub(crate) fn with_memory(mut self, memory: FieldMemory) -> Self {
        self.memory = Some(memory);
        self
    }

    /// Replaces the field by a filter ([`FilteredField`]): the loop without a NeRF.
    #[must_use]
    pub(crate) fn with_control(mut self, control: Arc<dyn Method + Send + Sync>) -> Self {
        self.control = Some(control);
        self
    }

    fn run(&self, task: &Task<'_>) -> crate::error::Result<Refined> {
        let config = Config { seed: task.seed, disparity: task.rule.clone(), ..self.config.clone() };
        if self.photographs && !task.views.is_empty() {
            return self.run_capture(task, &config);
        }
        let known = Known(PriorDepth::from_values(task.prior.to_owned(), DepthKind::Metric)?);
        let prior: &dyn DepthPrior = match task.model {
            Some(model) if config.augmentation.is_active() => model,
            _ => &known,
        };
        let stages = Stages::new(prior).with_field(|request| {
            Ok(match (&self.control, &self.memory) {
                (Some(control), _) => Box::new(FilteredField::new(control.clone(), request.seed)),
                (None, Some(memory)) if request.iteration == 0 => {
                    Box::new(memory.field(request.config.clone(), request.seed))
                }
                (None, _) => Box::new(request.nerf()?),
            })
        });
        let refinement = refine(task.image, task.camera, stages, &config, &mut |e| (self.callback)(e))?;
        Ok(Refined {
            depth: refinement.depth.mean().to_owned(),
            sigma: Some(refinement.depth.sigma()),
            report: json!({ "augmentation": refinement.augmentation, "iterations": refinement.iterations }),
        })
    }
}

impl LoopRefiner<'_> {
    /// Depth and sigma in the unit of the poses where they are given, else in the prior's.
    fn run_capture(&self, task: &Task<'_>, config: &Config) -> crate::error::Result<Refined> {
        let mask = Array2::from_elem(task.camera.dim(), true);
        let mut photographs = vec![Photograph {
            name: "reference".to_owned(),
            image: task.image.to_owned(),
            mask,
            camera: *task.camera,
            focal_assumed: task.focal_assumed,
            pose: task.views.iter().all(|view| view.posed).then(Pose::identity),
        }];
        photographs.extend(task.views.iter().zip(1..).map(|(view, index)| Photograph {
            name: format!("photograph {index}"),
            image: view.view.image.clone(),
            mask: view.view.mask.clone(),
            camera: view.view.camera,
            focal_assumed: task.focal_assumed,
            pose: view.posed.then_some(view.view.pose),
        }));
        let capture = Capture { photographs, reference: 0, matches: None, points: Vec::new() };
        let priors = OfTask(task);
        let refinement = refine_capture(&capture, Stages::new(&priors), config, &mut |e| (self.callback)(e))?;
        let used = refinement.capture.as_ref().filter(|report| report.fallback.is_none());
        let posed = capture.photographs[0].pose.is_some();
        let unit =
            used.filter(|_| posed).and_then(|report| report.scale).map_or(1.0, |[scale, _]| scale) as f32;
        Ok(Refined {
            depth: refinement.depth.mean().mapv(|z| unit * z),
            sigma: Some(refinement.depth.sigma().mapv(|sigma| unit * sigma)),
            report: json!({ "capture": refinement.capture, "iterations": refinement.iterations }),
        })
    }
}

impl Method for LoopRefiner<'_> {
    fn refine(&self, task: &Task<'_>) -> mde_eval::Result<Refined> {
        self.run(task).map_err(|error| match error {
            Error::Prior(error) => error.into(),
            Error::Warp(error) => error.into(),
            error => mde_eval::Error::Method(error.to_string()),
        })
    }
}

/// The monocular depths of the photographs of a task: those that are known, else the model's.
struct OfTask<'r, 't>(&'r Task<'t>);

impl DepthPrior for OfTask<'_, '_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let Self(task) = self;
        if image == task.image {
            return PriorDepth::from_values(task.prior.to_owned(), DepthKind::Metric);
        }
        let known = task.views.iter().find(|view| view.view.image == image).and_then(|view| view.prior);
        match (known, task.model) {
            (Some(depth), _) => PriorDepth::from_values(depth.clone(), DepthKind::Metric),
            (None, Some(model)) => model.predict(image),
            (None, None) => Err(mde_prior::Error::Input("no depth of this image; name a model".to_owned())),
        }
    }

    fn accepts_new_images(&self) -> bool {
        self.0.model.is_some() || self.0.views.iter().all(|view| view.prior.is_some())
    }

    fn concurrency(&self) -> usize {
        self.0.model.map_or(1, |model| model.concurrency())
    }
}

/// A prior with a known depth.
struct Known(PriorDepth);

impl DepthPrior for Known {
    fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        Ok(self.0.clone())
    }
}

/// Fitted fields and their renderings, by settings, seed and views. Clones share one memory.
#[derive(Clone, Default)]
pub(crate) struct FieldMemory(Arc<Mutex<HashMap<u64, Arc<Fitted>>>>);

struct Fitted {
    nerf: Nerf,
    report: FitReport,
    /// By camera, pose and the settings of the render.
    renders: Mutex<HashMap<u64, RenderedView>>,
}

impl FieldMemory {
    /// A field that is fitted only where the memory has none of the same settings, seed and views.
    pub(crate) fn field(&self, config: NerfConfig, seed: u64) -> Remembered {
        Remembered { memory: self.clone(), config, seed, fitted: None }
    }
}

/// A [`Nerf`] that shares a [`FieldMemory`].
pub(crate) struct Remembered {
    memory: FieldMemory,
    config: NerfConfig,
    seed: u64,
    fitted: Option<Arc<Fitted>>,
}

impl RadianceField for Remembered {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
        let key = fit_key(&self.config, self.seed, views);
        let known = lock(&self.memory.0).get(&key).cloned();
        let fitted = match known {
            Some(fitted) => fitted,
            None => {
                let mut nerf = Nerf::new(self.config.clone(), self.seed)?;
                let report = nerf.fit(views, callback)?;
                let fitted = Arc::new(Fitted { nerf, report, renders: Mutex::default() });
                lock(&self.memory.0).insert(key, fitted.clone());
                fitted
            }
        };
        let report = fitted.report.clone();
        self.fitted = Some(fitted);
        Ok(report)
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut dyn FieldCallback,
    ) -> mde_nerf::Result<RenderedView> {
        let Some(fitted) = &self.fitted else { return Err(mde_nerf::Error::NotFitted) };
        match lock(&fitted.renders).entry(view_key(camera, pose, &self.config)) {
            Entry::Occupied(known) => Ok(known.get().clone()),
            Entry::Vacant(place) => {
                let nerf = fitted.nerf.clone().with_render(self.config.render.clone())?;
                Ok(place.insert(nerf.render(camera, pose, callback)?).clone())
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn fit_key(config: &NerfConfig, seed: u64, views: &[PosedView]) -> u64 {
    let mut hasher = DefaultHasher::new();
    // The fit does not depend on the render settings. `Debug` shows every number of a configuration.
    let fit = NerfConfig { render: RenderConfig::default(), ..config.clone() };
    format!("{fit:?}").hash(&mut hasher);
    seed.hash(&mut hasher);
    for view in views {
        hash_view(&view.camera, &view.pose, &mut hasher);
        view.image.iter().for_each(|v| v.to_bits().hash(&mut hasher));
        view.mask.iter().for_each(|v| v.hash(&mut hasher));
        for depth in &view.hypotheses {
            depth.mean().iter().chain(depth.variance()).for_each(|v| v.to_bits().hash(&mut hasher));
        }
    }
    hasher.finish()
}

fn view_key(camera: &PinholeCamera, pose: &Pose, config: &NerfConfig) -> u64 {
    let mut hasher = DefaultHasher::new();
    format!("{:?}", config.render).hash(&mut hasher);
    hash_view(camera, pose, &mut hasher);
    hasher.finish()
}

fn hash_view(camera: &PinholeCamera, pose: &Pose, hasher: &mut DefaultHasher) {
    [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::to_bits).hash(hasher);
    [camera.width, camera.height].hash(hasher);
    pose.to_homogeneous().iter().for_each(|v| v.to_bits().hash(hasher));
}
