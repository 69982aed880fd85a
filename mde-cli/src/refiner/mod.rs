//! The way of every refinement: a [`Refiner`] takes a [`Scene`] through plan, prepare and refine.
//!
//! The program, the evaluations and the Python package call it.
//!
//! ```
//! use mde_cli::prior::origin::{PriorForm, PriorOrigin};
//! use mde_cli::refiner::Silent;
//! use mde_cli::scene::camera::{CameraSource, KnownCamera};
//! use mde_cli::{OpenPrior, Photograph, Preset, Refiner, Scene, Settings};
//! use mde_eval::scene::{Room, room};
//! use mde_eval::simulated::{SimulatedPriorConfig, simulated_prior};
//! use mde_cli::mde_prior::{DepthKind, FilePrior};
//!
//! let room = room(Room::Study, 0, 64, 48)?;
//! let simulated = simulated_prior(&room.depth, &SimulatedPriorConfig::default())?;
//! let origin = PriorOrigin::new(PriorForm::Simulated, DepthKind::Metric, "simulated");
//! let prior = OpenPrior::map(FilePrior::of_map("simulated", simulated), origin);
//! let refiner = Refiner::new(&prior, Settings::new(Preset::Default))?;
//!
//! let camera = KnownCamera { camera: room.camera, source: CameraSource::Scene };
//! let scene = Scene::one(Photograph::new("room", room.image, camera));
//! let plan = refiner.plan("room", (48, 64), 1)?;
//! let refined = refiner.prepare(&scene, &plan, &mut Silent)?.refine(0, None, &mut Silent)?;
//! assert_eq!(refined.refinement.depth.dim(), (48, 64));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bound;
pub mod calibration;
#[cfg(feature = "files")]
pub mod capture;
pub mod error_bar;
pub mod finish;
pub mod plan;
mod plausibility;
pub mod same_scale;
#[cfg(test)]
mod tests;

pub use error_bar::{ErrorBar, Stated};
pub use finish::{NOVEL, RENDERED, Refined, Unit, picture_of};
pub use plan::inference::PhotographMemory;
pub use plan::limit::MemoryLimit;
pub use plan::{SceneMemory, refine_bytes, render_bytes, scene_bytes};

use crate::config::{Config, Preset};
use crate::error::{Error, Result, text};
use crate::prior::{OpenPrior, PriorForm, PriorOrigin};
use crate::refinement::predict::known;
use crate::refinement::views::synthesise;
use crate::refinement::{Event, FieldFactory, Stages, refine};
use crate::refiner::bound::PhotographPrior;
use crate::scene::{CameraSource, KnownCamera, Photograph, Scene, Sizes};
use crate::several::prepared::PreparedScene;
use mde_prior::{DepthPrior, ModelSpec};
use mde_warp::{PinholeCamera, PosedView, WarpReport};
use ndarray::Array2;
use std::ops::ControlFlow;

/// Where events and warnings of a refinement go.
pub trait Observer {
    /// Progress; `Break` ends the refinement with [`Error::Interrupted`].
    fn event(&mut self, _: &Event) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// What the record of the run warns of. Arguments are named in braces, such as `{max-memory}`.
    fn warn(&mut self, _: String) {}
}

/// An observer of nothing.
pub struct Silent;

impl Observer for Silent {}

/// What a refiner does.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where the configuration begins.
    pub preset: Preset,
    /// The configuration.
    pub config: Config,
    /// Sizes of results and refinements.
    pub sizes: Sizes,
    /// Refinements that need more memory are refused.
    pub memory: MemoryLimit,
    /// The requested error bar.
    pub error_bar: ErrorBar,
    /// Unit of the results of several photographs.
    pub unit: Unit,
    /// Whether the fitted field is a part of the result.
    pub keep_field: bool,
    /// Whether files for other programs are made of the result, which takes memory.
    pub exports: bool,
}

impl Settings {
    /// Those of a preset, everything else as usual.
    pub fn new(preset: Preset) -> Self {
        Self {
            preset,
            config: preset.config(),
            sizes: Sizes::default(),
            memory: MemoryLimit::default(),
            error_bar: ErrorBar::default(),
            unit: Unit::Prior,
            keep_field: false,
            exports: false,
        }
    }
}

/// Memory of a scene's refinement, and the predictions side by side for which it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Estimate of the peak, bytes.
    pub bytes: u64,
    /// The part of it that scenes side by side share: the network.
    pub shared: u64,
    /// Predictions of the network that run side by side. The result does not depend on it.
    pub parallel_predictions: usize,
}

/// Bytes per pixel of the results for the files for other programs, and for the ends of an interval.
const EXPORTS: f64 = 40.0;
const INTERVAL: f64 = 8.0;

/// A prior with settings; refines any number of scenes.
pub struct Refiner<'p> {
    prior: &'p OpenPrior<'p>,
    settings: Settings,
}

impl<'p> Refiner<'p> {
    /// Checks the settings.
    ///
    /// # Errors
    /// Those of [`Config::validate`].
    pub fn new(prior: &'p OpenPrior<'p>, settings: Settings) -> Result<Self> {
        settings.config.validate()?;
        Ok(Self { prior, settings })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Where the prior comes from.
    pub fn origin(&self) -> &PriorOrigin {
        self.prior.origin()
    }

    /// Everything but the photographs and the camera that the results depend on, files by their content.
    ///
    /// # Errors
    /// Those of [`Config::to_toml`].
    pub fn identity(&self) -> Result<String> {
        let Settings { preset, config, sizes, error_bar, unit, keep_field, .. } = &self.settings;
        let origin = self.prior.origin();
        let prior = (origin.kind, &origin.model, &origin.model_hash, &origin.runtime);
        let identity = (
            (config.to_toml()?, preset.name(), (sizes.longest, sizes.megapixels)),
            (prior, self.prior.content()),
            (error_bar.identity()?, format!("{unit:?}"), keep_field),
        );
        serde_json::to_string(&identity).map_err(Error::external)
    }

    /// Memory of a scene of so many photographs of `(height, width)`, as given; `name` is for the refusal. No pixel is needed.
    ///
    /// # Errors
    /// [`Error::Argument`] where it exceeds the memory limit.
    pub fn plan(&self, name: &str, original: (usize, usize), photographs: usize) -> Result<Plan> {
        let Settings { config, sizes, memory: limit, error_bar, exports, .. } = &self.settings;
        let (prior, threads) = (self.prior.prior(), rayon::current_num_threads());
        let full = sizes.of_results(original);
        let at = sizes.of_refinement(full);
        let pixels = |(height, width)| height as u64 * width as u64;
        let priors = self.priors(photographs);
        let swept = |pixels| match photographs {
            0 | 1 => 0,
            _ => scene_bytes(pixels, photographs as u64, priors, threads as u64, config),
        };
        limit.check(name, at, swept)?;
        let mut memory = PhotographMemory::new(config, prior, [full, at], photographs, threads);
        let ends = if error_bar.probability().is_some() { INTERVAL } else { 0.0 };
        memory.held += pixels(full) as f64 * (ends + if *exports { EXPORTS } else { 0.0 });
        let parallel_predictions = memory.predictions_at_once(limit, name, at)?;
        let swept = |pixels| swept(pixels).saturating_add(memory.afterwards());
        limit.check(name, at, swept)?;
        let bytes = memory.bytes(pixels(at), parallel_predictions as u64).max(swept(pixels(at)));
        Ok(Plan { bytes, shared: memory.afterwards(), parallel_predictions })
    }

    /// Different priors of that many photographs: a map is the reference's alone, and without a prior all have the same.
    fn priors(&self, photographs: usize) -> u64 {
        let one = matches!(self.origin().form, PriorForm::Map | PriorForm::Nothing);
        if one { 1 } else { photographs as u64 }
    }

    /// The prior for a photograph: a map is resampled, a network's metres follow the focal length. An unknown camera is the network's.
    fn bind(
        &self,
        photograph: &Photograph,
        several: bool,
        seen: &mut dyn Observer,
    ) -> Result<(PhotographPrior<'_>, KnownCamera)> {
        self.prior.note.iter().for_each(|note| seen.warn(note.clone()));
        self.prior.swapped().into_iter().for_each(|warning| seen.warn(warning.to_owned()));
        let mut camera = photograph.camera.clone();
        // Further photographs give the focal length.
        if !several {
            camera = self.own_camera(photograph)?.unwrap_or(camera);
            camera.warning().into_iter().for_each(|warning| seen.warn(warning));
        }
        let mut warn = |warning| seen.warn(warning);
        Ok((PhotographPrior::new(self.prior, photograph, camera.focal(), &mut warn)?, camera))
    }

    /// The camera that the network estimates for a photograph whose camera is assumed, where it estimates one. It takes a prediction.
    fn own_camera(&self, photograph: &Photograph) -> Result<Option<KnownCamera>> {
        let origin = self.prior.origin();
        let has_camera = |spec: &ModelSpec| spec.camera_output.is_some() || spec.recover_shift;
        if !(photograph.camera.is_assumed() && origin.model.as_ref().is_some_and(has_camera)) {
            return Ok(None);
        }
        let predicted = self.prior.prior().predict(photograph.image.read()?.view())?;
        let Some([fx, fy, cx, cy]) = predicted.intrinsics else { return Ok(None) };
        let (height, width) = photograph.size();
        let camera = PinholeCamera::new(fx, fy, cx, cy, width, height).map_err(|error| {
            Error::Argument(format!("{}: its own camera: {}", origin.source, text(&error)))
        })?;
        Ok(Some(KnownCamera { camera, source: CameraSource::Network }))
    }

    /// Features and depth of a photograph, by which others are brought to its scale.
    ///
    /// # Errors
    /// Those of [`Refiner::prepare`], and of [`OneScale::prepare`](same_scale::OneScale::prepare).
    pub fn prepare_scale(
        &self,
        photograph: &Photograph,
        scale: &same_scale::OneScale,
        seen: &mut dyn Observer,
    ) -> Result<mde_mvs::poses::Prepared> {
        let (prior, camera) = self.bind(photograph, false, seen)?;
        scale.prepare(photograph.image.read()?.view(), &camera, &prior)
    }

    /// What the photographs of a scene share: the prior at their focal length; of several also predictions, poses and the choice of views.
    ///
    /// # Errors
    /// [`Error::Argument`] for a scene without its reference, the error of the prior, and those of [`PreparedScene::new`].
    pub fn prepare<'s>(
        &'s self,
        scene: &'s Scene,
        plan: &Plan,
        seen: &mut dyn Observer,
    ) -> Result<Prepared<'s>> {
        let Some(first) = scene.photographs.first() else {
            return Err(Error::Argument("there is no photograph; give one".to_owned()));
        };
        let (prior, camera) = self.bind(first, scene.is_several(), seen)?;
        if scene.same_scale.is_some_and(|found| found.is_alone()) {
            seen.warn("{same-scale}: matches no other photograph, and keeps its own scale".to_owned());
        }
        let mut several = None;
        if scene.is_several() {
            let mut stages = Stages::new(&prior).with_predictions_at_once(plan.parallel_predictions);
            stages.factors = metres_factors(&prior.origin, scene, &camera);
            let config = &self.settings.config;
            several = Some(PreparedScene::new(scene, &stages, config, &mut |event| seen.event(event))?);
        }
        let parallel_predictions = plan.parallel_predictions;
        Ok(Prepared { refiner: self, scene, prior, camera, several, parallel_predictions })
    }
}

/// What brings metres at the focal length of `camera` to those of each photograph; nothing for a network whose metres do not depend on it.
fn metres_factors(origin: &PriorOrigin, scene: &Scene, camera: &KnownCamera) -> Vec<f32> {
    let canonical = origin.model.as_ref().and_then(|spec| spec.canonical_focal);
    let (Some(_), Some(own)) = (canonical, camera.focal()) else { return Vec::new() };
    let factor = |one: &Photograph| one.camera.focal().map_or(1.0, |focal| (focal / own) as f32);
    scene.photographs.iter().map(factor).collect()
}

/// A scene after what its photographs share.
pub struct Prepared<'s> {
    refiner: &'s Refiner<'s>,
    scene: &'s Scene,
    prior: PhotographPrior<'s>,
    /// Of the reference.
    camera: KnownCamera,
    several: Option<PreparedScene<'s>>,
    parallel_predictions: usize,
}

impl<'s> Prepared<'s> {
    /// For one result at most, as [`PreparedScene::once`].
    #[must_use]
    pub fn once(self) -> Self {
        Self { several: self.several.map(PreparedScene::once), ..self }
    }

    /// Refines a photograph: the reference of one, any of several. `field` makes the field in the place of [`Config::nerf`]'s.
    ///
    /// # Errors
    /// The error of a stage, [`Error::Interrupted`] after a `Break` of the observer, [`Error::Argument`] for known depths without a scale.
    pub fn refine(
        &mut self,
        photograph: usize,
        field: Option<&mut FieldFactory<'_>>,
        seen: &mut dyn Observer,
    ) -> Result<Refined<'s>> {
        let Self { refiner, scene, prior, several, .. } = self;
        let (refiner, scene) = (*refiner, *scene);
        let Some(shown) = scene.photographs.get(photograph) else {
            let reason = format!("photograph {photograph} of {}", scene.photographs.len());
            return Err(Error::Capture { reason, remedy: "give the index of one of them" });
        };
        let mut camera = if photograph == 0 { self.camera.clone() } else { shown.camera.clone() };
        let config = &refiner.settings.config;
        let mut stages = Stages::new(&*prior).with_predictions_at_once(self.parallel_predictions);
        if let Some(factory) = field {
            stages = stages.with_field(factory);
        }
        stages.serves_one = prior.origin.form != PriorForm::Nothing;
        let mut observe = |event: &Event| seen.event(event);
        let mut image = shown.image.read()?;
        let mut refinement = match several {
            Some(several) => several.refine(photograph, stages, &mut observe)?,
            None => refine(image.view(), &camera.camera, stages, config, &mut observe)?,
        };
        if refiner.settings.keep_field && refinement.field.is_none() {
            seen.warn(
                "{keep-field}: no field was fitted, so there is none; several photographs and the preset paper fit one"
                    .to_owned(),
            );
        }
        if let Some(full) = &shown.full {
            refinement = refinement.upsampled(image.view(), full.view())?;
            (image, camera) = (full.clone(), camera.resized(shown.of_results())?);
        }
        self.finish(refinement, photograph, (image, camera), &mut |text| seen.warn(text))
    }

    /// The prior's depth of the reference, `[height, width]` of its refinement; 0 where missing.
    ///
    /// # Errors
    /// The error of the prior, and [`Error::Prior`] for disparities without a depth.
    pub fn prior_depth(&self) -> Result<Array2<f32>> {
        if let Some(depth) = self.several.as_ref().and_then(|several| several.prior_depth(0)) {
            return Ok(depth.to_owned());
        }
        let image = self.scene.photographs[0].image.read()?;
        Ok(self.prior.predict(image.view())?.to_depth(&self.refiner.settings.config.disparity)?)
    }

    /// The camera of the reference.
    pub fn camera(&self) -> KnownCamera {
        let several = self.several.as_ref();
        let found = several.and_then(|several| several.camera(several.reference()));
        self.camera.clone().or_estimated(found, several.and_then(|several| several.report().focal_sigma))
    }

    /// Poses and verdicts of several photographs.
    pub fn several(&self) -> Option<&PreparedScene<'s>> {
        self.several.as_ref()
    }

    /// Where the prior comes from, with the metres that the focal length gives.
    pub fn origin(&self) -> &PriorOrigin {
        &self.prior.origin
    }

    /// Seconds of predictions that no result has yet.
    pub fn prior_seconds(&self) -> f64 {
        self.prior.seconds()
    }

    /// The synthetic views of the reference (Section III.A, Eq. 1), the photograph itself first.
    ///
    /// # Errors
    /// The error of the prior or of a warp.
    pub fn synthetic_views(&self) -> Result<(Vec<PosedView>, WarpReport)> {
        let photograph = &self.scene.photographs[0];
        let depth = self.prior_depth()?;
        crate::refinement::check_prior(depth.view(), photograph.size())?;
        let config = &self.refiner.settings.config;
        synthesise(photograph.image.read()?.view(), &self.camera.camera, &known(depth)?, config, 0)
    }
}
