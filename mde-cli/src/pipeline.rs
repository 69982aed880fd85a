//! The iterative loop (Section III): prior, views, fit, render, reproject, fuse, again.
//!
//! It knows the stages only through their traits: [`DepthPrior`], [`RadianceField`] and [`Fuser`].

pub use crate::augmentation::known;
use crate::augmentation::{AugmentationReport, Component, Start, of_view, start};
use crate::config::{Config, IterationPrior};
use crate::error::{LEAST, MOST};
use crate::report::{IterationReport, WarpReport};
use crate::{Error, Result};
use mde_eval::metrics::rank::spearman;
use mde_fusion::{Fused, Fuser, Prior};
use mde_nerf::RadianceField;
use mde_prior::DepthPrior;
use mde_uncertainty::GaussianDepth;
use mde_warp::random::CounterRng;
use mde_warp::{PinholeCamera, Pose, PosedView, forward_warp, median, reproject, sample_poses};
use ndarray::{Array2, ArrayView2, ArrayView3};
use rand::Rng;
use std::ops::ControlFlow;
use std::time::Instant;

/// A part of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The monocular depth (III.B).
    Prior,
    /// The synthetic views (III.A).
    Warp,
    /// The field's fit (III.C).
    Fit,
    /// The novel views and their way back (III.D).
    Render,
    /// The fusion (III.E).
    Fuse,
}

impl Stage {
    /// A word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Prior => "prior",
            Self::Warp => "warp",
            Self::Fit => "fit",
            Self::Render => "render",
            Self::Fuse => "fuse",
        }
    }
}

/// What the loop tells its caller.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A stage begins.
    Begin {
        /// Which.
        stage: Stage,
        /// Iteration, from 0.
        iteration: usize,
        /// Iterations in all.
        iterations: usize,
    },
    /// The field's own events; `view` counts the rendered views.
    Field {
        /// The event.
        event: mde_nerf::Event,
        /// View being rendered, from 0; 0 in the fit.
        view: usize,
        /// Views to be rendered.
        views: usize,
    },
    /// The model finished a prediction.
    Predicted {
        /// Predictions so far.
        done: usize,
        /// Predictions in total.
        total: usize,
    },
}

/// Hears of progress and may say stop.
pub type Observer<'o> = dyn FnMut(&Event) -> ControlFlow<()> + 'o;

/// Makes the field of an iteration (counted from 0).
pub type FieldFactory<'f> = dyn FnMut(usize) -> Result<Box<dyn RadianceField>> + 'f;

/// The stages that a run is composed of.
pub struct Stages<'s> {
    /// Where the monocular depth comes from.
    pub prior: &'s dyn DepthPrior,
    /// Makes a fresh field an iteration.
    pub field: &'s mut FieldFactory<'s>,
    /// Fuses what the field renders with the prior.
    pub fuser: &'s dyn Fuser,
}

/// What a run gives.
pub struct Refinement {
    /// The refined depth and its variance, `[height, width]`, z in the prior's unit.
    pub depth: GaussianDepth,
    /// The monocular depth that it started from, `[height, width]`; 0 where missing.
    pub prior: Array2<f32>,
    /// Report of the prior's stage.
    pub augmentation: AugmentationReport,
    /// What the standard deviation is made of, part by part.
    pub components: Vec<Component>,
    /// An account of every iteration.
    pub iterations: Vec<IterationReport>,
    /// The field of the last iteration, if there was one.
    pub field: Option<Box<dyn RadianceField>>,
}

/// What a run is between two iterations: all that the next one depends on, beside the inputs and the settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// The monocular depth that it started from, `[height, width]`; 0 where missing.
    pub prior: Array2<f32>,
    /// The refined depth so far.
    pub depth: GaussianDepth,
    /// An account of every iteration so far.
    pub iterations: Vec<IterationReport>,
}

/// Hears of what a run is after each iteration but the last.
pub type Keeper<'k> = dyn FnMut(&Checkpoint) -> Result<()> + 'k;

/// Refines the monocular depth of `image` (`[height, width, 3]`, sRGB in 0 to 1) taken by `camera`.
///
/// # Errors
/// What a stage refuses, [`Error::EmptyPrior`], [`Error::Range`], [`Error::Size`], or [`Error::Interrupted`] where the
/// observer said stop.
pub fn refine(
    image: ArrayView3<'_, f32>,
    camera: &PinholeCamera,
    stages: Stages<'_>,
    config: &Config,
    observer: &mut Observer<'_>,
) -> Result<Refinement> {
    resume(image, camera, stages, config, None, &mut |_| Ok(()), observer)
}

/// The same, from where an earlier run of the same inputs and settings had come to (`from`); `keep` hears of every iteration
/// that another one follows. The result has the bits of a run that was never broken off.
///
/// # Errors
/// As [`refine`], and what `keep` says.
pub fn resume(
    image: ArrayView3<'_, f32>,
    camera: &PinholeCamera,
    stages: Stages<'_>,
    config: &Config,
    from: Option<Checkpoint>,
    keep: &mut Keeper<'_>,
    observer: &mut Observer<'_>,
) -> Result<Refinement> {
    config.validate()?;
    let mut run = Run { image, camera, config, observer };
    let Start { prior, depth: anchor, mut components, report: augmentation } = run.start(stages.prior)?;
    check_prior(prior.view(), image)?;
    if !config.refinement.fits_a_field(augmentation.predictions > 1) {
        let depth = with_common_error(anchor, config.fusion.common_error)?;
        components.push(common(&depth, config.fusion.common_error));
        return Ok(Refinement {
            depth,
            prior,
            augmentation,
            components,
            iterations: Vec::new(),
            field: None,
        });
    }
    let (mut current, mut iterations) = match from {
        Some(Checkpoint { depth, iterations, .. }) => (depth, iterations),
        None => (anchor.clone(), Vec::new()),
    };
    loop {
        let index = iterations.len();
        let fusion_prior = match (index, config.refinement.prior) {
            // A single prediction has no spread: the fusion estimates its variance.
            (0, _) | (_, IterationPrior::Anchor) if augmentation.predictions == 1 => {
                Prior::new(prior.clone())?
            }
            (0, _) | (_, IterationPrior::Anchor) => Prior::with_variance(anchor.clone())?,
            (_, IterationPrior::Carry) => Prior::with_variance(current.clone())?,
            (_, IterationPrior::Reestimate) => Prior::new(current.mean().to_owned())?,
        };
        let field = (stages.field)(index)?;
        let (fused, field, report) = run.iterate(index, &current, &fusion_prior, field, &stages)?;
        iterations.push(report);
        if iterations.len() >= config.refinement.iterations {
            components.push(Component { name: "field", sigma: fused.aligned.sigma() });
            components.push(common(&fused.depth, config.fusion.common_error));
            let (depth, field) = (fused.depth, Some(field));
            return Ok(Refinement { depth, prior, augmentation, components, iterations, field });
        }
        let progress = Checkpoint { prior: prior.clone(), depth: fused.depth, iterations };
        keep(&progress)?;
        Checkpoint { depth: current, iterations, .. } = progress;
    }
}

/// The original photograph and its warps by `depth`: what a field is fitted to (Eq. 1).
///
/// # Errors
/// What the warp refuses, or [`Error::EmptyPrior`].
pub fn synthesise(
    image: ArrayView3<'_, f32>,
    camera: &PinholeCamera,
    depth: &GaussianDepth,
    config: &Config,
    iteration: usize,
) -> Result<(Vec<PosedView>, WarpReport)> {
    let original = PosedView::new(
        image.to_owned(),
        *camera,
        Pose::identity(),
        Array2::from_elem(depth.dim(), true),
        vec![depth.clone()],
    )?;
    let scale = median_depth(depth)?;
    let seed = derived_seed(config.seed, "training-poses", iteration);
    let mut views = vec![original];
    let mut report = WarpReport::default();
    for pose in sample_poses(&config.views, scale, seed)? {
        let warped = forward_warp(image, depth, camera, &Pose::identity(), camera, &pose, &config.warp)?;
        report.add(&warped);
        views.push(warped.view);
    }
    Ok((views, report))
}

struct Run<'r, 'o> {
    image: ArrayView3<'r, f32>,
    camera: &'r PinholeCamera,
    config: &'r Config,
    observer: &'r mut Observer<'o>,
}

impl Run<'_, '_> {
    fn begin(&mut self, stage: Stage, iteration: usize) -> Result<Instant> {
        let event = Event::Begin { stage, iteration, iterations: self.config.refinement.iterations };
        match (self.observer)(&event) {
            ControlFlow::Continue(()) => Ok(Instant::now()),
            ControlFlow::Break(()) => Err(Error::Interrupted),
        }
    }

    /// The prior's stage.
    fn start(&mut self, model: &dyn DepthPrior) -> Result<Start> {
        let begin = self.begin(Stage::Prior, 0)?;
        let observer = &mut *self.observer;
        let mut listen = |done: usize, total: usize| observer(&Event::Predicted { done, total });
        let mut start = start(model, self.image, self.config, &mut listen)?;
        start.report.seconds = begin.elapsed().as_secs_f64();
        Ok(start)
    }

    /// Once round the loop: `current` makes the views, `prior` meets what the field saw.
    fn iterate(
        &mut self,
        index: usize,
        current: &GaussianDepth,
        prior: &Prior,
        mut field: Box<dyn RadianceField>,
        stages: &Stages<'_>,
    ) -> Result<(Fused, Box<dyn RadianceField>, IterationReport)> {
        let mut report = IterationReport::default();
        let start = self.begin(Stage::Warp, index)?;
        let (mut views, warp) = synthesise(self.image, self.camera, current, self.config, index)?;
        if self.config.refinement.ask_views && stages.prior.accepts_new_images() {
            self.ask_views(&mut views, stages.prior)?;
        }
        report.warp = warp;
        report.seconds.warp = start.elapsed().as_secs_f64();

        let start = self.begin(Stage::Fit, index)?;
        let observer = &mut *self.observer;
        let mut listen =
            |event: &mde_nerf::Event| observer(&Event::Field { event: *event, view: 0, views: 0 });
        report.fit = field.fit(&views, &mut listen)?;
        report.seconds.fit = start.elapsed().as_secs_f64();
        drop(views);

        let start = self.begin(Stage::Render, index)?;
        let evidence = self.evidence(index, median_depth(current)?, &*field)?;
        report.seconds.render = start.elapsed().as_secs_f64();

        let start = self.begin(Stage::Fuse, index)?;
        let fused = stages.fuser.fuse(prior, &evidence)?;
        report.seconds.fuse = start.elapsed().as_secs_f64();
        report.fusion = fused.report.clone();
        (report.field_prior_spearman, report.field_prior_deviation) =
            agreement(prior.mean(), &fused.aggregated)?;
        Ok((fused, field, report))
    }

    /// Adds what the model says of the synthetic views to their hypotheses.
    fn ask_views(&mut self, views: &mut [PosedView], model: &dyn DepthPrior) -> Result<()> {
        let synthetic = views.len().saturating_sub(1);
        let each = self.config.augmentation.predictions();
        for (index, view) in views.iter_mut().skip(1).enumerate() {
            let observer = &mut *self.observer;
            let mut listen = |done: usize, _: usize| {
                observer(&Event::Predicted { done: index * each + done, total: synthetic * each })
            };
            if let Some(said) = of_view(model, view, self.config, &mut listen)? {
                view.hypotheses.push(said);
            }
        }
        Ok(())
    }

    /// What the field sees, brought back to the original camera (Eq. 6).
    fn evidence(
        &mut self,
        index: usize,
        scale: f64,
        field: &dyn RadianceField,
    ) -> Result<Vec<GaussianDepth>> {
        let seed = derived_seed(self.config.seed, "novel-poses", index);
        let mut poses = sample_poses(&self.config.novel.sampling, scale, seed)?;
        if self.config.novel.original {
            poses.insert(0, Pose::identity());
        }
        let mut evidence = Vec::new();
        for (view, pose) in poses.iter().enumerate() {
            let observer = &mut *self.observer;
            let views = poses.len();
            let mut listen = |event: &mde_nerf::Event| observer(&Event::Field { event: *event, view, views });
            let seen = field.render(self.camera, pose, &mut listen)?;
            let back = reproject(
                &seen.depth,
                self.camera,
                pose,
                self.camera,
                &Pose::identity(),
                &self.config.reproject,
            )?;
            evidence.push(back);
        }
        Ok(evidence)
    }
}

/// The depth with an error that no answer shows, as a share of it.
fn with_common_error(depth: GaussianDepth, share: f64) -> Result<GaussianDepth> {
    let share = share as f32;
    Ok(depth.map(|mean, variance| (mean, variance + (share * mean).powi(2))))
}

fn common(depth: &GaussianDepth, share: f64) -> Component {
    let sigma = depth.mean().mapv(|z| if z > 0.0 { share as f32 * z } else { f32::INFINITY });
    Component { name: "common", sigma }
}

fn check_prior(prior: ArrayView2<'_, f32>, image: ArrayView3<'_, f32>) -> Result<()> {
    let [height, width] = [image.shape()[0], image.shape()[1]];
    if prior.dim() != (height, width) {
        return Err(Error::Size { prior: [prior.nrows(), prior.ncols()], image: [height, width] });
    }
    let known = || prior.iter().copied().filter(|&d| d > 0.0);
    let (nearest, farthest) = (known().fold(f32::INFINITY, f32::min), known().fold(0.0, f32::max));
    match (nearest, farthest) {
        (_, 0.0) => Err(Error::EmptyPrior),
        (LEAST.., ..=MOST) => Ok(()),
        _ => Err(Error::Range { nearest, farthest }),
    }
}

fn median_depth(depth: &GaussianDepth) -> Result<f64> {
    median(depth.mean().iter().copied().filter(|&d| d > 0.0)).map(f64::from).ok_or(Error::EmptyPrior)
}

fn derived_seed(seed: u64, purpose: &str, iteration: usize) -> u64 {
    CounterRng::new(seed, purpose, iteration as u64, 0).next_u64()
}

/// Spearman's correlation of the field's depth with the prior's, and the median of \\(|D_r / D_o - 1|\\), over the
/// pixels that both know; nothing where there are none.
fn agreement(prior: ArrayView2<'_, f32>, field: &GaussianDepth) -> Result<(Option<f64>, Option<f64>)> {
    let (field, prior): (Vec<f64>, Vec<f64>) = field
        .mean()
        .iter()
        .zip(field.variance())
        .zip(prior)
        .filter(|&((_, variance), prior)| variance.is_finite() && *prior > 0.0)
        .map(|((mean, _), prior)| (f64::from(*mean), f64::from(*prior)))
        .unzip();
    if field.is_empty() {
        return Ok((None, None));
    }
    let deviation = median(field.iter().zip(&prior).map(|(f, p)| (f / p - 1.0).abs() as f32));
    Ok((spearman(&field, &prior)?, deviation.map(f64::from)))
}
