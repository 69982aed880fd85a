//! One refinement from opened inputs to a folder of results.

use crate::program::args::UnitName;
use crate::program::open::camera::KnownCamera;
use crate::program::open::truth::{Comparison, Truth};
use crate::program::store::folder::{OutputFolder, RECORD};
use crate::program::provenance::{about, write_json};
use crate::program::{report, summary};
use crate::program::progress::Progress;
use anyhow::{Context, Result};
use crate::prior::bound::BoundPrior;
use crate::scene::known::Known;
use crate::scene::photograph::Opened;
use crate::refiner::depth_png::DepthPng;
use crate::output::export::{Exported, Format};
use crate::output::preview::strip;
use crate::output::record::{About, RunRecord};
use crate::refiner::error_bar::ErrorBar;
use crate::refiner::finish::{Finish, Finished, SameScale};
use crate::output::maps::Maps;
use crate::refiner::run::{Done, Run, Watch};
use crate::several::Capture;
use crate::reports::prediction::Component;
use crate::config::{Config, Preset};
use crate::refinement::event::Event;
use crate::naming::Naming;
use crate::reports::Refinement;
use mde_prior::DepthKind;
use mde_prior::photo::write_image;
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, ArrayView3};
use serde_json::json;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

/// A refinement with what is written of it.
pub(crate) struct Job<'p> {
    pub(crate) command: &'static str,
    pub(crate) input: String,
    /// The photograph, at its size.
    pub(crate) opened: Opened,
    pub(crate) prior: BoundPrior<'p>,
    pub(crate) preset: Preset,
    pub(crate) config: Config,
    pub(crate) truth: Option<Truth>,
    pub(crate) save_field: bool,
    /// The requested error bar.
    pub(crate) error_bar: ErrorBar,
    /// Files for other programs.
    pub(crate) export: Vec<Format>,
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
    /// Most of the model's predictions at once.
    pub(crate) at_once: usize,
}

/// A refinement with its scores.
pub(crate) struct Scored<'s> {
    pub(crate) done: Done<'s>,
    scores: Option<Comparison>,
    score_seconds: f64,
}

impl Watch for Progress {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        self.observe(event)
    }

    fn warn(&mut self, warning: String) {
        Self::warn(self, warning);
    }

    fn step(&mut self, what: &str) {
        Self::step(self, what);
    }
}

impl Job<'_> {
    /// Refines, scores, writes and prints.
    pub(crate) fn run(self, folder: &OutputFolder, progress: &mut Progress) -> Result<()> {
        let Scored { done, scores, .. } = self.produce(folder, progress, |_, _, _| Ok(()))?;
        let table = scores.as_ref().map(|scores| scores.table() + "\n").unwrap_or_default();
        let value =
            json!({ "event": "done", "output": folder.path().display().to_string(), "scores": scores });
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
    ) -> Result<Scored<'_>> {
        let done = self.of_capture(self.capture.as_ref()).refine(progress)?;
        let scored = self.scored(done, progress)?;
        folder.write(|path| {
            self.write(path, &self.input, &scored, progress)?;
            last(path, &scored.done, progress)
        })?;
        Ok(scored)
    }

    /// The refinement; with further photographs, those of `capture`.
    pub(crate) fn of_capture<'s>(&'s self, capture: Option<&'s Capture>) -> Run<'s> {
        Run {
            opened: &self.opened,
            prior: &self.prior,
            capture,
            finish: Finish {
                config: &self.config,
                origin: self.prior.origin(),
                error_bar: &self.error_bar,
                known: self.known.as_ref(),
                same_scale: self.same_scale,
                unit: self.unit.into(),
                naming: Naming::Flags,
            },
            at_once: self.at_once,
            keeps_field: self.save_field,
        }
    }

    /// Unit of the results.
    pub(crate) fn unit(&self) -> &'static str {
        self.of_capture(None).finish.unit()
    }

    /// Whether the scale of a model's map is not known.
    fn is_unscaled(&self) -> bool {
        self.prior.origin().model.is_some() && self.known.is_none() && self.capture.is_none()
    }

    /// A refinement with its scores.
    pub(crate) fn scored<'s>(&self, done: Done<'s>, progress: &mut Progress) -> Result<Scored<'s>> {
        let start = Instant::now();
        let scores = match &self.truth {
            Some(truth) => {
                progress.step("score");
                Some(truth.compare(&done.result.refinement, self.prior.origin().kind)?)
            }
            None => None,
        };
        Ok(Scored { done, scores, score_seconds: start.elapsed().as_secs_f64() })
    }

    /// All files of the refinement of `input`.
    pub(crate) fn write(
        &self,
        path: &Path,
        input: &str,
        scored: &Scored<'_>,
        progress: &Progress,
    ) -> Result<()> {
        let Scored { done, scores, score_seconds } = scored;
        let refinement = &done.result.refinement;
        self.write_maps(path, done)?;
        if let Some(field) = done.field.as_ref().filter(|_| self.save_field) {
            field.lock().save(path.join("field.safetensors"))?;
        }
        let about = About {
            preset: Some(self.preset.name()),
            seed: Some(self.config.seed),
            warnings: progress.warnings(),
            total_seconds: progress.seconds(),
            ..about(self.command, input.to_owned(), &done.camera)
        };
        let origin = self.prior.origin();
        let record = RunRecord {
            scores: scores.as_ref(),
            score_seconds: *score_seconds,
            ..RunRecord::new(about, origin, &done.result, progress.training(), done.prior_seconds)
        };
        write_json(&path.join(RECORD), &record)?;
        let Refinement { depth, prior, components, certainty, .. } = refinement;
        let scene = Exported {
            certainty: certainty.as_ref().map(|own| (own.meaning, own.map.view())),
            ..self.scene(done.image, &done.camera, depth, prior, components)
        };
        self.export.iter().try_for_each(|format| scene.write(*format, path))?;
        report::write(path)?;
        Ok(())
    }

    fn scene<'s>(
        &'s self,
        image: ArrayView3<'s, f32>,
        camera: &'s KnownCamera,
        depth: &'s GaussianDepth,
        prior: &'s Array2<f32>,
        components: &'s [Component],
    ) -> Exported<'s> {
        Exported {
            unit: self.unit(),
            image,
            camera: &camera.camera,
            depth,
            prior: prior.view(),
            components: components.iter().map(|part| (part.name, part.sigma.view())).collect(),
            certainty: None,
            png_scale: DepthPng::new(self.unit(), depth.mean().iter().copied()).scale,
        }
    }

    fn write_maps(&self, folder: &Path, done: &Done<'_>) -> Result<()> {
        let Finished { refinement, png, stated, .. } = &done.result;
        let sigma = refinement.depth.sigma();
        let bounds = stated.interval.as_ref().map(|interval| interval.bounds(&refinement.depth));
        let mut more = Vec::new();
        if let Some([lower, upper]) = &bounds {
            more.extend([("lower", lower.view()), ("upper", upper.view())]);
        }
        more.extend(self.truth.as_ref().map(|truth| ("gt", truth.depth.view())));
        let evidence = refinement.capture.as_ref().and_then(|capture| capture.evidence.as_ref());
        let evidence: Vec<_> = evidence.iter().flat_map(|evidence| evidence.arrays()).collect();
        let metric = self.prior.origin().kind == DepthKind::Metric;
        Maps {
            depth: &refinement.depth,
            sigma: sigma.view(),
            prior: refinement.prior.view(),
            more: &more,
            evidence: &evidence.iter().map(|(name, map)| (*name, map.view())).collect::<Vec<_>>(),
            image: done.image,
            pictures: &done.pictures(),
            strip: &strip(&done.shown(), done.image.dim().1),
            truth: self.truth.as_ref().filter(|_| metric).map(|truth| truth.depth.view()),
            png,
        }
        .write(folder)?;
        let config = self.of_capture(None).settings(done)?;
        mde_prior::write_atomic(&folder.join("config.toml"), config.as_bytes())?;
        if let Some(capture) = self.capture.as_ref().filter(|_| self.keep_photographs) {
            let path = folder.join("photographs");
            fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
            for photograph in &capture.photographs {
                write_image(path.join(&photograph.name), photograph.image.view())?;
            }
        }
        Ok(())
    }
}
