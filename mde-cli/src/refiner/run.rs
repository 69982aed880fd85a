//! One refinement from an opened photograph to its result, in the order of its steps:
//!
//! | Step | Where |
//! |---|---|
//! | the photograph at its size, with its camera | [`Opened`] |
//! | the prior for it: a map resampled | [`BoundPrior::resampled`] |
//! | the memory limit | [`Opened::predictions_at_once`] |
//! | a network's own camera, which takes a prediction | [`Opened::take_camera_of`] |
//! | the network's metres by the focal length | [`BoundPrior::at_focal`] |
//! | refinement, the photograph's own size, unit and error bar | [`Run::refine`] |
//!
//! The program and the Python package follow it.

use crate::refiner::size::thumbnail;
use crate::refiner::prior::bound::BoundPrior;
use crate::refiner::camera::KnownCamera;
use crate::refiner::photograph::Opened;
use crate::refiner::finish::{Finish, Finished};
use crate::several::{Capture, refine_capture};
use crate::refinement::{Checkpoint, resume};
use crate::config::Config;
use crate::refinement::event::Event;
use crate::several::prepared::PreparedCapture;
use crate::reports::Refinement;
use crate::error::Result;
use crate::refinement::shared::SharedNerf;
use crate::refinement::stages::Stages;
use mde_nerf::RadianceField;
use mde_prior::Timed;
use mde_prior::augment::Predictions;
use ndarray::{Array3, ArrayView3};
use std::ops::ControlFlow;
use std::time::Duration;

/// Where events and warnings of a run go.
pub trait Watch {
    /// Progress of the loop; `Break` ends the run.
    fn event(&mut self, event: &Event) -> ControlFlow<()>;

    /// What the record of the run warns of.
    fn warn(&mut self, warning: String);

    /// A step outside of the loop begins.
    fn step(&mut self, _what: &str) {}
}

/// Passes on the state after an iteration.
type Keep<'h> = dyn Fn(&Checkpoint) -> Result<()> + 'h;
/// Puts a field around that of an iteration, which counts from 0.
type Around<'h> = dyn Fn(usize, Box<dyn RadianceField>) -> Box<dyn RadianceField> + 'h;

/// What a run does between its iterations, if anything.
#[derive(Default)]
pub struct Hooks<'h> {
    /// The state of an earlier run with the same inputs and settings, from which this one continues.
    pub from: Option<Checkpoint>,
    /// Called with the state after every iteration but the last.
    pub keep: Option<&'h Keep<'h>>,
    /// Called with the field of every iteration.
    pub field: Option<&'h Around<'h>>,
}

/// A refinement of one photograph.
pub struct Run<'r> {
    /// The photograph, at its size.
    pub opened: &'r Opened,
    /// Its prior.
    pub prior: &'r BoundPrior<'r>,
    /// Further photographs; the reference is that of `opened`.
    pub capture: Option<&'r Capture>,
    /// What the refinement becomes a result by.
    pub finish: Finish<'r>,
    /// Time for the prior's predictions.
    pub budget: Option<Duration>,
    /// Most of the prior's predictions at once.
    pub at_once: usize,
    /// Whether the field is wanted: a run without one has a warning.
    pub keeps_field: bool,
}

/// A refinement that is done.
pub struct Done<'r> {
    /// The photograph at the size of the maps, sRGB in 0 to 1, `[height, width, 3]`.
    pub image: ArrayView3<'r, f32>,
    /// Its camera.
    pub camera: KnownCamera,
    /// The maps with their error bar.
    pub result: Finished,
    /// Further photographs.
    pub capture: Option<&'r Capture>,
    /// Index of the photograph among them.
    pub photograph: usize,
    /// The field of the last iteration, where one was fitted.
    pub field: Option<SharedNerf>,
    /// Seconds of the prior's predictions.
    pub prior_seconds: f64,
}

impl<'r> Run<'r> {
    /// Refines the photograph.
    ///
    /// # Errors
    /// Those of [`resume`], [`refine_capture`] and [`Finish::apply`].
    pub fn refine(&self, hooks: Hooks<'_>, watch: &mut dyn Watch) -> Result<Done<'r>> {
        let Self { opened, capture, finish, .. } = self;
        let naming = finish.naming;
        // Further photographs give the focal length.
        if capture.is_none() {
            opened.camera.warning(naming).into_iter().for_each(|warning| watch.warn(warning));
        }
        let alone = finish.same_scale.and_then(|found| found.warning(naming));
        alone.into_iter().for_each(|warning| watch.warn(warning));
        let prior = Timed::new(self.prior);
        let mut field = None;
        let mut stages = Stages::new(&prior).with_predictions_at_once(self.at_once);
        if let Some(budget) = self.budget {
            stages = stages.with_budget(budget);
        }
        let Hooks { from, keep, field: around } = hooks;
        let stages = stages.with_field(|request| {
            let fitted = Box::new(field.insert(SharedNerf::new(request.nerf()?)).clone());
            Ok(match around {
                Some(around) => around(request.iteration, fitted),
                None => fitted,
            })
        });
        let mut keeper = |state: &Checkpoint| keep.map_or(Ok(()), |keep| keep(state));
        let mut observe = |event: &Event| watch.event(event);
        let (image, camera, config) = (opened.image.view(), &opened.camera.camera, finish.config);
        let mut refinement = match capture {
            Some(capture) => refine_capture(capture, stages, config, &mut observe)?,
            None => resume(image, camera, stages, config, from, &mut keeper, &mut observe)?,
        };
        if self.keeps_field && field.is_none() {
            watch.warn(format!(
                "{}: no field was fitted, so there is none; give the preset paper, or several photographs, to fit one",
                naming.choose("--save-field", "keep_field")
            ));
        }
        let (mut image, mut camera) = (image, opened.camera.clone());
        if let Some(full) = &opened.full {
            watch.step("to the photograph's own size");
            refinement = refinement.upsampled(image, full.image.view())?;
            (image, camera) = (full.image.view(), full.camera.clone());
        }
        let photograph = capture.map_or(0, |capture| capture.reference);
        let result = self.finished(refinement, photograph, &mut camera, watch)?;
        let prior_seconds = prior.seconds();
        Ok(Done { image, camera, result, capture: *capture, photograph, field, prior_seconds })
    }

    /// Refines one of the photographs of the capture, which were prepared together.
    ///
    /// # Errors
    /// Those of [`PreparedCapture::refine`] and [`Finish::apply`].
    pub fn refine_one(
        &self,
        prepared: &mut PreparedCapture<'r>,
        photograph: usize,
        watch: &mut dyn Watch,
    ) -> Result<Done<'r>> {
        let capture = prepared.capture();
        let prior = Timed::new(self.prior);
        let mut field = None;
        let stages = Stages::new(&prior)
            .with_predictions_at_once(self.at_once)
            .with_field(|request| Ok(Box::new(field.insert(SharedNerf::new(request.nerf()?)).clone())));
        let refinement = prepared.refine(photograph, stages, &mut |event| watch.event(event))?;
        let one = &capture.photographs[photograph];
        let mut camera = KnownCamera { camera: one.camera, ..self.opened.camera.clone() };
        let result = self.finished(refinement, photograph, &mut camera, watch)?;
        let (image, prior_seconds) = (one.image.view(), prior.seconds());
        Ok(Done { image, camera, result, capture: Some(capture), photograph, field, prior_seconds })
    }

    fn finished(
        &self,
        refinement: Refinement,
        photograph: usize,
        camera: &mut KnownCamera,
        watch: &mut dyn Watch,
    ) -> Result<Finished> {
        let result = self.finish.apply(refinement, photograph, camera, &mut |warning| watch.warn(warning))?;
        result.png.warning().into_iter().for_each(|warning| watch.warn(warning));
        Ok(result)
    }

    /// The settings with which the run is repeated: the clock of a budget chose the number of predictions.
    pub fn repeating(&self, done: &Done<'_>) -> Config {
        let mut config = self.finish.config.clone();
        if self.budget.is_some() {
            let predictions = done.result.refinement.augmentation.predictions as u32;
            config.augmentation.predictions = Predictions::Most(predictions);
        }
        config
    }

    /// [`repeating`](Self::repeating) as TOML, with the number of predictions and its reason in a comment.
    ///
    /// # Errors
    /// Those of [`Config::to_toml`].
    pub fn settings(&self, done: &Done<'_>) -> Result<String> {
        let report = &done.result.refinement.augmentation;
        let comment = report.reason.as_ref().map(|reason| {
            let unit = if report.predictions == 1 { "prediction" } else { "predictions" };
            format!("# {} {unit}: {reason}\n", report.predictions)
        });
        Ok(comment.unwrap_or_default() + &self.repeating(done).to_toml()?)
    }
}

impl<'r> Done<'r> {
    /// The photographs that were used, this one first; none where there is one alone.
    pub fn shown(&self) -> Vec<ArrayView3<'r, f32>> {
        let Some((capture, report)) = self.capture.zip(self.result.refinement.capture.as_ref()) else {
            return Vec::new();
        };
        let used = capture.photographs.iter().zip(&report.photographs).enumerate();
        let used = used.filter(|(index, (_, report))| report.used && *index != self.photograph);
        let others = used.map(|(_, (photograph, _))| photograph.image.view());
        std::iter::once(self.image).chain(others).collect()
    }

    /// Pictures of several photographs, by the names of their files: the photographs, small, and the novel view beside what the field
    /// renders.
    pub fn pictures(&self) -> Vec<(String, Array3<u8>)> {
        let Some((capture, report)) = self.capture.zip(self.result.refinement.capture.as_ref()) else {
            return Vec::new();
        };
        let small = |image: &Array3<f32>| bytes(thumbnail(image.view()).view());
        let photographs = capture.photographs.iter().enumerate();
        let mut pictures: Vec<_> =
            photographs.map(|(index, one)| (picture_of(index), small(&one.image))).collect();
        if let Some(novel) = &report.novel {
            pictures.push((NOVEL.to_owned(), bytes(novel.image.view())));
            pictures.push((RENDERED.to_owned(), bytes(novel.rendered.view())));
        }
        pictures
    }
}

/// The folder of [`Done::pictures`].
pub const PICTURES: &str = "views";
/// The photograph that the field renders.
pub const NOVEL: &str = "views/novel.png";
/// Its rendering.
pub const RENDERED: &str = "views/rendered.png";

/// The small picture of a photograph.
pub fn picture_of(index: usize) -> String {
    format!("{PICTURES}/{index:02}.png")
}

/// sRGB in 0 to 1 as bytes.
pub fn bytes(image: ArrayView3<'_, f32>) -> Array3<u8> {
    image.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}
