//! One refinement from opened inputs to a folder of results.

use crate::args::{ExportName, UnitName};
use crate::input::camera::KnownCamera;
use crate::input::prior::NamedPrior;
use crate::input::truth::{Comparison, Truth};
use crate::output::folder::{OutputFolder, RECORD};
use crate::output::provenance::{about, write_json};
use crate::output::recording::Recording;
use crate::output::several;
use crate::report;
use crate::run::checkpoint::Checkpoints;
use crate::run::gain;
use crate::run::progress::Progress;
use anyhow::Result;
use mde_cli::inputs::Known;
use mde_cli::pictures16::{DepthPng, write_confidence};
use mde_cli::results::export::Exported;
use mde_cli::results::preview::{Preview, preview, strip};
use mde_cli::results::{About, ErrorBar, Finish, Finished, RunRecord, SameScale, TrainingCurve};
use mde_cli::{
    Capture, Component, Config, Event, Naming, Preset, Refinement, SharedNerf, Stages, refine_capture, resume,
};
use mde_prior::augment::Predictions;
use mde_prior::format::write_npy;
use mde_prior::photo::{write_image, write_rgb_png};
use mde_prior::{DepthKind, Timed};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, Array3, ArrayView3};
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

/// Inputs of a refinement.
pub(crate) struct Job<'p> {
    pub(crate) command: &'static str,
    pub(crate) input: String,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub(crate) image: Array3<f32>,
    pub(crate) camera: KnownCamera,
    pub(crate) prior: NamedPrior<'p>,
    pub(crate) preset: Preset,
    pub(crate) config: Config,
    pub(crate) truth: Option<Truth>,
    pub(crate) save_field: bool,
    /// Checkpoints of `--resume`.
    pub(crate) checkpoints: Option<Checkpoints>,
    /// The requested error bar.
    pub(crate) error_bar: ErrorBar,
    /// Files for other programs.
    pub(crate) export: Vec<ExportName>,
    /// Whether exported points have y up.
    pub(crate) y_up: bool,
    /// The recording of `--rerun`.
    pub(crate) recording: Option<Recording>,
    /// Further photographs.
    pub(crate) capture: Option<Capture>,
    /// Unit of the results with further photographs.
    pub(crate) unit: UnitName,
    /// Depths that give the scale.
    pub(crate) known: Option<Known>,
    /// The factor that gives photographs one scale.
    pub(crate) same_scale: Option<SameScale>,
    /// Whether the photographs are written too, as they are.
    pub(crate) keep_photographs: bool,
    /// Time for the model's predictions.
    pub(crate) budget: Option<Duration>,
    /// Most of the model's predictions at once.
    pub(crate) at_once: usize,
    /// The photograph at the size of the results, where that is larger.
    pub(crate) full: Option<Full>,
}

/// A photograph that is refined at a smaller size.
pub(crate) struct Full {
    pub(crate) image: Array3<f32>,
    pub(crate) camera: KnownCamera,
}

impl Full {
    /// The camera of the smaller photograph, for this size.
    pub(crate) fn take_camera(&mut self, camera: &KnownCamera) -> Result<()> {
        self.camera = camera.resized(self.size())?;
        Ok(())
    }

    /// `(height, width)`.
    pub(crate) fn size(&self) -> (usize, usize) {
        let (height, width, _) = self.image.dim();
        (height, width)
    }
}

/// The photograph that is refined.
pub(crate) struct Subject<'s> {
    pub(crate) input: &'s str,
    pub(crate) image: ArrayView3<'s, f32>,
    pub(crate) camera: KnownCamera,
}

/// A refinement with its error bar and its scores.
pub(crate) struct Done<'s> {
    pub(crate) subject: Subject<'s>,
    pub(crate) result: Finished,
    /// Index of the subject among the photographs.
    photograph: usize,
    scores: Option<Comparison>,
    score_seconds: f64,
    /// Seconds of the prior's predictions.
    pub(crate) prior_seconds: f64,
}

impl Job<'_> {
    /// Refines, scores, writes and prints.
    pub(crate) fn run(self, folder: &OutputFolder, progress: &mut Progress) -> Result<()> {
        let done = self.produce(folder, progress, |_, _, _| Ok(()))?;
        let table = done.scores.as_ref().map(|scores| scores.table() + "\n").unwrap_or_default();
        let value =
            json!({ "event": "done", "output": folder.path().display().to_string(), "scores": done.scores });
        let mut gained = gain::summary(&done.result, self.is_unscaled());
        if let Some(interval) = &done.result.stated.interval {
            gained += &format!(
                "\nlower.npy and upper.npy: {:.0} % interval, the depth -+ {:.2} sigma, by {}",
                100.0 * interval.probability,
                interval.half_width,
                interval.by
            );
        }
        let report = folder.path().join(report::FILE);
        let text = format!(
            "{table}{gained}\nwrote {} in {:.1} s; open {} in a browser",
            folder.path().display(),
            progress.seconds(),
            report.display()
        );
        progress.result(&text, value);
        Ok(())
    }

    /// Refines, scores and writes; `last` adds files to the folder before it gets its name.
    pub(crate) fn produce(
        &self,
        folder: &OutputFolder,
        progress: &mut Progress,
        last: impl FnOnce(&Path, &Done<'_>, &Progress) -> Result<()>,
    ) -> Result<Done<'_>> {
        let mut kept = None;
        let prior = Timed::new(&*self.prior.prior);
        let mut stages = Stages::new(&prior).with_predictions_at_once(self.at_once);
        if let Some(budget) = self.budget {
            stages = stages.with_budget(budget);
        }
        let stages = stages.with_field(|request| {
            let field = Box::new(kept.insert(SharedNerf::new(request.nerf()?)).clone());
            Ok(match &self.recording {
                Some(recording) => recording.watch(request.iteration + 1, self.capture.is_none(), field),
                None => field,
            })
        });
        let from = self.checkpoints.as_ref().and_then(|kept| kept.latest(self.config.refinement.iterations));
        if let Some(from) = &from {
            progress.step(&format!("resumed after iteration {}", from.iterations.len()));
            if let Some(recording) = &self.recording {
                from.iterations.iter().for_each(|iteration| recording.fitted(iteration.fit.steps));
            }
        }
        let start = Subject { input: &self.input, image: self.image.view(), camera: self.camera.clone() };
        let mut keep = |state: &mde_cli::Checkpoint| {
            if let Some(recording) = &self.recording {
                recording.depth(state.iterations.len(), &self.scene(&start, &state.depth, &state.prior, &[]));
                recording.sigma(state.iterations.len(), &state.depth);
            }
            match &self.checkpoints {
                Some(checkpoints) => {
                    checkpoints.keep(state).map_err(|e| mde_cli::Error::external(crate::message(&e)))
                }
                None => Ok(()),
            }
        };
        let mut observe = |event: &Event| progress.observe(event);
        let image = self.image.view();
        let mut refinement = match &self.capture {
            Some(capture) => refine_capture(capture, stages, &self.config, &mut observe)?,
            None => resume(image, &self.camera.camera, stages, &self.config, from, &mut keep, &mut observe)?,
        };
        if self.save_field && kept.is_none() {
            progress.warn(
                "--save-field: no field was fitted, so none is written; set refinement.field = \"always\" to fit one".to_owned(),
            );
        }
        let reference = self.capture.as_ref().map_or(0, |capture| capture.reference);
        let mut subject = Subject { input: &self.input, image, camera: self.camera.clone() };
        if let Some(full) = &self.full {
            progress.step("to the photograph's own size");
            refinement = refinement.upsampled(image, full.image.view())?;
            (subject.image, subject.camera) = (full.image.view(), full.camera.clone());
        }
        let mut done = self.finished(subject, refinement, reference, progress)?;
        done.prior_seconds = prior.seconds();
        folder.write(|path| {
            self.write(path, &done, kept.as_ref(), progress)?;
            last(path, &done, progress)
        })?;
        if let Some(checkpoints) = &self.checkpoints {
            checkpoints.discard();
        }
        if let Some(recording) = &self.recording {
            self.record(recording, &done, progress.training())?;
        }
        Ok(done)
    }

    fn finish(&self) -> Finish<'_> {
        Finish {
            config: &self.config,
            origin: &self.prior.origin,
            error_bar: &self.error_bar,
            known: self.known.as_ref(),
            same_scale: self.same_scale,
            unit: self.unit.into(),
            naming: Naming::Flags,
        }
    }

    /// Unit of the results.
    pub(crate) fn unit(&self) -> &'static str {
        self.finish().unit()
    }

    /// Whether the scale of a model's map is not known.
    fn is_unscaled(&self) -> bool {
        self.prior.origin.model.is_some() && self.known.is_none() && self.capture.is_none()
    }

    /// Warnings, unit, error bar and scores; `photograph` is the index of the subject within the capture.
    pub(crate) fn finished<'s>(
        &self,
        mut subject: Subject<'s>,
        refinement: Refinement,
        photograph: usize,
        progress: &mut Progress,
    ) -> Result<Done<'s>> {
        let mut warn = |warning| progress.warn(warning);
        let result = self.finish().apply(refinement, photograph, &mut subject.camera, &mut warn)?;
        let start = Instant::now();
        let scores = match &self.truth {
            Some(truth) => {
                progress.step("score");
                Some(truth.compare(&result.refinement, self.prior.origin.kind)?)
            }
            None => None,
        };
        let score_seconds = start.elapsed().as_secs_f64();
        result.png.warning().into_iter().for_each(|warning| progress.warn(warning));
        Ok(Done { subject, result, photograph, scores, score_seconds, prior_seconds: 0.0 })
    }

    /// All files of one refinement.
    pub(crate) fn write(
        &self,
        path: &Path,
        done: &Done<'_>,
        field: Option<&SharedNerf>,
        progress: &Progress,
    ) -> Result<()> {
        let refinement = &done.result.refinement;
        self.write_maps(path, done)?;
        self.write_interval(path, &done.result)?;
        if let Some(field) = field.filter(|_| self.save_field) {
            field.lock().save(path.join("field.safetensors"))?;
        }
        let about = About {
            preset: Some(self.preset.name()),
            seed: Some(self.config.seed),
            warnings: progress.warnings(),
            total_seconds: progress.seconds(),
            ..about(self.command, done.subject.input.to_owned(), &done.subject.camera)
        };
        let origin = &self.prior.origin;
        let record = RunRecord {
            scores: done.scores.as_ref(),
            score_seconds: done.score_seconds,
            ..RunRecord::new(about, origin, &done.result, progress.training(), done.prior_seconds)
        };
        write_json(&path.join(RECORD), &record)?;
        let scene = Exported {
            confidence: refinement.confidence.as_ref().map(|confidence| confidence.view()),
            ..self.scene(&done.subject, &refinement.depth, &refinement.prior, &refinement.components)
        };
        self.export.iter().try_for_each(|format| scene.write((*format).into(), path))?;
        report::write(path)?;
        Ok(())
    }

    fn scene<'s>(
        &'s self,
        subject: &'s Subject<'_>,
        depth: &'s GaussianDepth,
        prior: &'s Array2<f32>,
        components: &'s [Component],
    ) -> Exported<'s> {
        Exported {
            unit: self.unit(),
            image: subject.image,
            camera: &subject.camera.camera,
            depth,
            prior: prior.view(),
            components: components.iter().map(|part| (part.name, part.sigma.view())).collect(),
            confidence: None,
            y_up: self.y_up,
            png_scale: DepthPng::new(self.unit(), depth.mean().iter().copied()).scale,
        }
    }

    /// Records the inputs, the result and the reports; the iterations were recorded during the run.
    fn record(&self, recording: &Recording, done: &Done<'_>, training: &[TrainingCurve]) -> Result<()> {
        let Refinement { depth, prior, iterations, .. } = &done.result.refinement;
        let last = iterations.len().max(1);
        let known = prior.mapv(|z| if z > 0.0 { 1.0 } else { f32::INFINITY });
        let before = GaussianDepth::new(prior.clone(), known)?;
        recording.inputs(
            &self.input,
            &self.scene(&done.subject, &before, prior, &[]),
            &self.config.to_toml()?,
        );
        if iterations.is_empty() && training.is_empty() {
            // Without a fit, prior and result would share a time on the timeline of steps.
            recording.fitted(1);
        }
        if let Some((capture, report)) = self.capture.as_ref().zip(done.result.refinement.capture.as_ref()) {
            recording.photographs(capture, report);
        }
        recording.depth(last, &self.scene(&done.subject, depth, prior, &[]));
        recording.sigma(last, depth);
        recording.reports(iterations, training);
        recording.save()
    }

    /// The photographs that were used, the reference first; none where there is one alone.
    fn shown<'s>(&'s self, done: &'s Done<'_>) -> Vec<ArrayView3<'s, f32>> {
        let Some((capture, report)) = self.capture.as_ref().zip(done.result.refinement.capture.as_ref())
        else {
            return Vec::new();
        };
        let used = capture.photographs.iter().zip(&report.photographs).enumerate();
        let used = used.filter(|(index, (_, report))| report.used && *index != done.photograph);
        let others = used.map(|(_, (photograph, _))| photograph.image.view());
        std::iter::once(done.subject.image).chain(others).collect()
    }

    fn write_interval(&self, folder: &Path, result: &Finished) -> Result<()> {
        let Some(interval) = &result.stated.interval else { return Ok(()) };
        let [lower, upper] = interval.bounds(&result.refinement.depth);
        write_npy(folder.join("lower.npy"), lower.view())?;
        Ok(write_npy(folder.join("upper.npy"), upper.view())?)
    }

    fn write_maps(&self, folder: &Path, done: &Done<'_>) -> Result<()> {
        let Done { result: Finished { refinement, png, .. }, subject, .. } = done;
        let (Refinement { depth: refined, prior, .. }, image) = (refinement, subject.image);
        let (depth, sigma) = (refined.mean(), refined.sigma());
        let strip = strip(&self.shown(done), image.dim().1);
        let show = Preview {
            image,
            prior: prior.view(),
            refined: depth,
            sigma: sigma.view(),
            unit: self.unit(),
            strip: &strip,
            truth: self
                .truth
                .as_ref()
                .filter(|_| self.prior.origin.kind == DepthKind::Metric)
                .map(|truth| truth.depth.view()),
        };
        let files: [&(dyn Fn() -> Result<()> + Sync); 7] = [
            &|| Ok(write_npy(folder.join("depth.npy"), depth)?),
            &|| Ok(write_npy(folder.join("sigma.npy"), sigma.view())?),
            &|| Ok(write_npy(folder.join("prior.npy"), prior.view())?),
            &|| Ok(png.write(&folder.join("depth.png"), depth)?),
            &|| Ok(write_confidence(&folder.join("confidence.png"), refined)?),
            &|| Ok(write_rgb_png(folder.join("preview.png"), preview(&show).pixels())?),
            &|| Ok(write_image(folder.join("image.png"), image)?),
        ];
        // Side by side: of a photograph of 12 megapixels they take seconds.
        files.par_iter().try_for_each(|write| write())?;
        let mut config = self.config.clone();
        if self.budget.is_some() {
            // The clock chose the number; with it the run repeats.
            config.augmentation.predictions = Predictions::Most(refinement.augmentation.predictions as u32);
        }
        mde_prior::write_atomic(&folder.join("config.toml"), config.to_toml()?.as_bytes())?;
        if let Some((capture, report)) = self.capture.as_ref().zip(refinement.capture.as_ref()) {
            several::write(folder, capture, report, self.keep_photographs)?;
        }
        if let Some(truth) = &self.truth {
            write_npy(folder.join("gt.npy"), truth.depth.view())?;
        }
        Ok(())
    }
}
