//! The loop of Section III, in the order in which a photograph passes through it:
//!
//! | Stage | Paper | Where |
//! |---|---|---|
//! | prior | III.B | [`DepthPrior`], with test-time augmentation where it is configured |
//! | warp | III.A, Eq. 1 | [`synthesise`] |
//! | fit | III.C | [`RadianceField::fit`] |
//! | render | III.D, Eq. 2-6 | [`RadianceField::render`], [`reproject`](mde_warp::reproject) |
//! | fuse | III.E, Eq. 7-17 | [`Fuser`] |
//!
//! [`refine`] runs it; [`Stages`] names the implementations.

pub mod event;
pub mod predict;
pub mod scale;
pub mod stages;
mod upsample;
pub mod views;

pub use event::{Callback, Event, Stage};
pub use stages::{FieldFactory, FieldRequest, Stages};

use crate::config::{Config, IterationPrior};
use crate::error::{Error, Result};
use crate::refinement::predict::{Start, predict};
use crate::refinement::views::synthesise;
use crate::reports::{Component, IterationReport, Refinement};
use mde_fusion::{BayesFuser, Fused, Fuser, Prior};
use mde_nerf::RadianceField;
use mde_prior::DepthPrior;
use mde_prior::augment::Progress;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::{median, spearman};
use mde_warp::PinholeCamera;
use ndarray::{ArrayView2, ArrayView3};
use std::time::Instant;
use views::median_depth;

/// Refines the monocular depth of `image` (`[height, width, 3]`, sRGB in 0 to 1) taken by `camera`.
///
/// # Errors
/// The error of a stage, [`Error::EmptyPrior`], [`Error::Size`], [`Error::Argument`] for a prior out of range, [`Error::Interrupted`].
pub fn refine(
    image: ArrayView3<'_, f32>,
    camera: &PinholeCamera,
    mut stages: Stages<'_>,
    config: &Config,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    config.validate()?;
    let mut run = Run { image, camera, config, callback };
    let Start { prior, depth: anchor, mut components, certainty, report: augmentation } =
        run.predict(stages.prior, stages.at_once)?;
    check_prior(prior.view(), (image.dim().0, image.dim().1))?;
    if !config.refinement.fits_a_field() {
        let share = augmentation.common_error.unwrap_or(config.fusion.common_error);
        let depth = anchor.map(|mean, variance| (mean, variance + (share as f32 * mean).powi(2)));
        components.push(shared_error(&depth, share));
        return Ok(Refinement { depth, augmentation, components, certainty, ..Refinement::of_prior(prior) });
    }
    let bayes = BayesFuser::new(config.fusion.clone())?;
    let fuser = stages.fuser.unwrap_or(&bayes);
    let (mut current, mut iterations) = (anchor.clone(), Vec::new());
    loop {
        let index = iterations.len();
        let fusion_prior = match config.refinement.prior {
            IterationPrior::Carry if index > 0 => Prior::with_variance(current.clone())?,
            // A single prediction has no spread: the fusion estimates its variance.
            _ if augmentation.predictions == 1 => Prior::new(prior.clone())?,
            _ => Prior::with_variance(anchor.clone())?,
        };
        let field = stages.field(config, index)?;
        let (fused, field, report) = run.iterate(index, &current, &fusion_prior, field, fuser)?;
        iterations.push(report);
        if iterations.len() >= config.refinement.iterations {
            components.push(Component { name: "field", sigma: fused.aligned.sigma() });
            components.push(shared_error(&fused.depth, config.fusion.common_error));
            return Ok(Refinement {
                depth: fused.depth,
                augmentation,
                components,
                iterations,
                field: Some(field),
                certainty,
                ..Refinement::of_prior(prior)
            });
        }
        current = fused.depth;
    }
}

struct Run<'r, 'c> {
    image: ArrayView3<'r, f32>,
    camera: &'r PinholeCamera,
    config: &'r Config,
    callback: &'r mut Callback<'c>,
}

impl Run<'_, '_> {
    fn begin(&mut self, stage: Stage, iteration: usize) -> Result<Instant> {
        event::begin(self.callback, stage, iteration, self.config.refinement.iterations)
    }

    /// The prior's stage.
    fn predict(&mut self, model: &dyn DepthPrior, at_once: Option<usize>) -> Result<Start> {
        let begin = self.begin(Stage::Prior, 0)?;
        let (callback, iterations) = (&mut *self.callback, self.config.refinement.iterations);
        let mut listen = |progress| match progress {
            Progress::Predicted { done, total } => {
                callback(&Event::Part { stage: Stage::Prior, done, total })
            }
            Progress::Merging => callback(&Event::Begin { stage: Stage::Merge, iteration: 0, iterations }),
        };
        let mut start = predict(model, self.image, self.config, at_once, &mut listen)?;
        start.report.seconds = begin.elapsed().as_secs_f64();
        Ok(start)
    }

    /// One iteration: `current` is warped to the training views, `prior` is fused with the rendered views.
    fn iterate(
        &mut self,
        index: usize,
        current: &GaussianDepth,
        prior: &Prior,
        mut field: Box<dyn RadianceField>,
        fuser: &dyn Fuser,
    ) -> Result<(Fused, Box<dyn RadianceField>, IterationReport)> {
        let mut report = IterationReport::default();
        let start = self.begin(Stage::Warp, index)?;
        let (views, warp) = synthesise(self.image, self.camera, current, self.config, index)?;
        report.warp = warp;
        report.seconds.warp = start.elapsed().as_secs_f64();

        let start = self.begin(Stage::Fit, index)?;
        report.fit = field.fit(&views, &mut event::of_field(self.callback, 0, 0))?;
        report.seconds.fit = start.elapsed().as_secs_f64();
        drop(views);

        let start = self.begin(Stage::Render, index)?;
        let seen =
            views::render(&*field, self.camera, median_depth(current)?, self.config, index, self.callback)?;
        report.seconds.render = start.elapsed().as_secs_f64();

        let start = self.begin(Stage::Fuse, index)?;
        let fused = fuser.fuse(prior, &seen)?;
        report.seconds.fuse = start.elapsed().as_secs_f64();
        report.fusion = fused.report.clone();
        (report.field_prior_spearman, report.field_prior_deviation) =
            agreement(prior.mean(), &fused.aggregated)?;
        Ok((fused, field, report))
    }
}

/// The part of sigma from the error that all predictions share.
fn shared_error(depth: &GaussianDepth, share: f64) -> Component {
    let sigma = depth.mean().mapv(|z| if z > 0.0 { share as f32 * z } else { f32::INFINITY });
    Component { name: "common", sigma }
}

/// Depths that the loop works with: their variances, and a thousandth of those, are floats.
const LEAST: f32 = 1e-12;
const MOST: f32 = 1e12;

pub(crate) fn check_prior(prior: ArrayView2<'_, f32>, (height, width): (usize, usize)) -> Result<()> {
    if prior.dim() != (height, width) {
        return Err(Error::Size { prior: [prior.nrows(), prior.ncols()], image: [height, width] });
    }
    let known = || prior.iter().copied().filter(|&d| d > 0.0);
    let (nearest, farthest) = (known().fold(f32::INFINITY, f32::min), known().fold(0.0, f32::max));
    match (nearest, farthest) {
        (_, 0.0) => Err(Error::EmptyPrior),
        (LEAST.., ..=MOST) => Ok(()),
        _ => Err(Error::Argument(format!(
            "the prior's depths reach from {nearest:e} to {farthest:e}; give depths of {LEAST:e} to {MOST:e} (check the prior's scale)"
        ))),
    }
}

/// Spearman's correlation of the field's depth with the prior's, and the median of \\(|D_r / D_o - 1|\\), over pixels known to both, if any.
fn agreement(prior: ArrayView2<'_, f32>, field: &GaussianDepth) -> Result<(Option<f64>, Option<f64>)> {
    let both = field.mean().into_iter().zip(field.variance()).zip(prior);
    let both = both.filter(|((_, variance), prior)| variance.is_finite() && **prior > 0.0);
    let (field, prior): (Vec<f64>, Vec<f64>) =
        both.map(|((mean, _), prior)| (f64::from(*mean), f64::from(*prior))).unzip();
    if field.is_empty() {
        return Ok((None, None));
    }
    let deviation = median(field.iter().zip(&prior).map(|(f, p)| (f / p - 1.0).abs()));
    Ok((spearman(&field, &prior)?, deviation))
}
