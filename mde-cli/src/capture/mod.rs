//! Several photographs of one static scene, in the order in which they pass through the loop:
//!
//! | Stage | What | Where |
//! |---|---|---|
//! | prior | one prediction per photograph | [`DepthPrior`](mde_prior::DepthPrior) |
//! | poses | refined where given, estimated from matches and the prior where not | [`mde_mvs::poses`] |
//! | sweep | plane sweeps of every photograph and their consensus, exposures | [`mde_mvs::consensus`], [`mde_mvs::exposure`] |
//! | fit | a field on all photographs and their consensus depths | [`RadianceField::fit`](mde_nerf::RadianceField::fit) |
//! | render | depth and variance of the reference (Eq. 2-5) | [`RadianceField::render`](mde_nerf::RadianceField::render) |
//! | fuse | unit, fallback and standard deviation | [`mod@self`] |
//!
//! The poses fix the gauge, so the prior is brought to the field and not the field to the prior (`docs/method.md`).

mod cameras;
mod guard;
mod priors;
mod report;
mod result;

pub use report::{CaptureReport, CaptureSeconds, PhotographReport, PoseSource, WithheldPhotograph};

use crate::config::{Config, Preset};
use crate::pipeline::{Callback, Event, Refinement, Stage, Stages, refine};
use crate::{Error, Result};
use cameras::Posed;
use mde_mvs::consensus::{ConsensusConfig, Reconstruction, reconstruct};
use mde_mvs::exposure::fit_exposure;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3, ArrayView2, Zip};
use std::ops::ControlFlow;
use std::time::Instant;

/// One of several photographs.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// Its name in reports and messages; unique within a capture.
    pub name: String,
    /// sRGB in 0 to 1, `[height, width, 3]`, without lens distortion.
    pub image: Array3<f32>,
    /// False where the image has no content, `[height, width]`.
    pub mask: Array2<bool>,
    /// Its intrinsics.
    pub camera: PinholeCamera,
    /// Whether the focal length is a guess, to be estimated with the poses.
    pub focal_assumed: bool,
    /// World to camera, in the capture's unit; none where it is to be estimated.
    pub pose: Option<Pose>,
}

/// Photographs of one static scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Two or more; all with a pose or all without.
    pub photographs: Vec<Photograph>,
    /// Index of the photograph whose depth is refined.
    pub reference: usize,
}

impl Capture {
    /// Checks the number of photographs, the reference, sizes, cameras and poses.
    ///
    /// # Errors
    /// [`Error::Capture`] with the photograph at fault and the remedy.
    pub fn validate(&self) -> Result<()> {
        let count = self.photographs.len();
        if count < 2 || self.reference >= count {
            let reason = format!("{count} photographs, reference {}", self.reference);
            return Err(capture(reason, "give two or more, and a reference among them"));
        }
        let posed = self.photographs.iter().filter(|p| p.pose.is_some()).count();
        if posed != 0 && posed != count {
            return Err(capture(
                format!("{posed} of {count} photographs have a pose"),
                "give poses for all of them or for none",
            ));
        }
        for (index, photograph) in self.photographs.iter().enumerate() {
            if self.photographs[..index].iter().any(|other| other.name == photograph.name) {
                return Err(capture(format!("two photographs are named {}", photograph.name), "rename one"));
            }
            view(photograph, photograph.pose.unwrap_or_else(Pose::identity), photograph.camera)?
                .validate()
                .map_err(|error| {
                capture(format!("{}: {error}", photograph.name), "check the photograph and its camera")
            })?;
        }
        Ok(())
    }
}

pub(crate) fn capture(reason: String, remedy: &'static str) -> Error {
    Error::Capture { reason, remedy }
}

fn view(photograph: &Photograph, pose: Pose, camera: PinholeCamera) -> Result<PosedView> {
    Ok(PosedView {
        image: photograph.image.clone(),
        camera,
        pose,
        mask: photograph.mask.clone(),
        hypotheses: Vec::new(),
    })
}

/// Refines the depth of the reference photograph with the parallax of the others.
///
/// Depth and sigma are `[height, width]` of the reference, z in the prior's unit. Where the photographs carry no depth (no
/// common scene, no parallax, hardly anything verified, or a withheld photograph that the prior explains better), the result is that of [`refine`] with [`Preset::Default`] for the reference
/// alone, and [`CaptureReport::fallback`] has the reason.
///
/// # Errors
/// The error of a stage, [`Error::Capture`] for a capture that [`Capture::validate`] refuses, and those of [`refine`].
pub fn refine_capture(
    capture: &Capture,
    mut stages: Stages<'_>,
    config: &Config,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    config.validate()?;
    capture.validate()?;
    let mut run = Run { config, callback };
    let mut report = CaptureReport::new(capture);

    let start = run.begin(Stage::Prior)?;
    let priors = priors::predict(capture, stages.prior, config, |done, total| {
        run.notify(&Event::Predicted { done, total })
    })?;
    report.seconds.prior = start.elapsed().as_secs_f64();

    let start = run.begin(Stage::Poses)?;
    let posed = cameras::posed(capture, &priors, config, &mut report)?;
    report.seconds.poses = start.elapsed().as_secs_f64();
    let Some(Posed { mut views, order, unit }) = posed else {
        return fall_back(capture, stages, config, report, run.callback);
    };

    let start = run.begin(Stage::Sweep)?;
    let depths = priors::for_views(&views, &order, &priors, unit)?;
    let depths: Vec<ArrayView2<'_, f32>> = depths.iter().map(|depth| depth.view()).collect();
    let reconstruction = reconstruct(&views, &depths, None, &ConsensusConfig::default())?;
    report.take(&reconstruction, &order);
    report.seconds.sweep = start.elapsed().as_secs_f64();
    report.withheld_colours = guard::withheld(&views, &depths, &order, &reconstruction, capture)?;
    if let Some(reason) = result::unusable(&reconstruction).or_else(|| guard::contradiction(&report)) {
        report.fallback = Some(reason);
        return fall_back(capture, stages, config, report, run.callback);
    }
    equalise(&mut views, &reconstruction, &order, &mut report)?;
    for (view, known) in views.iter_mut().zip(&reconstruction.views) {
        view.hypotheses = vec![known.fused.clone()];
    }

    let (mut rendered, mut field) = (None, None);
    if config.refinement.iterations > 0 {
        let start = run.begin(Stage::Fit)?;
        let mut fitted = stages.field(config, 0)?;
        report.fit = Some(fitted.fit(&views, &mut |event: &mde_nerf::FieldEvent| {
            run.notify(&Event::Field { event: *event, view: 0, views: 0 })
        })?);
        report.seconds.fit = start.elapsed().as_secs_f64();

        let start = run.begin(Stage::Render)?;
        rendered =
            Some(fitted.render(&views[0].camera, &views[0].pose, &mut |event: &mde_nerf::FieldEvent| {
                run.notify(&Event::Field { event: *event, view: 0, views: 1 })
            })?);
        report.seconds.render = start.elapsed().as_secs_f64();
        field = Some(fitted);
    }
    run.begin(Stage::Fuse)?;
    let (depth, components) = result::combine(&reconstruction, &views, rendered.as_ref(), unit)?;
    let prior = priors[capture.reference].clone().ok_or(Error::EmptyPrior)?;
    report.scale = Some(result::scale(&reconstruction, unit));
    Ok(Refinement { depth, components, field, capture: Some(report), ..Refinement::of_prior(prior) })
}

/// The reference alone, with the default preset.
fn fall_back(
    capture: &Capture,
    stages: Stages<'_>,
    config: &Config,
    report: CaptureReport,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    let alone = Config { seed: config.seed, disparity: config.disparity.clone(), ..Preset::Default.config() };
    let reference = &capture.photographs[capture.reference];
    let refined = refine(reference.image.view(), &reference.camera, stages, &alone, callback)?;
    Ok(Refinement { capture: Some(report), ..refined })
}

/// The photographs in the reference's exposure, fitted where other photographs confirm its depth.
fn equalise(
    views: &mut [PosedView],
    reconstruction: &Reconstruction,
    order: &[usize],
    report: &mut CaptureReport,
) -> Result<()> {
    let Some(((reference, others), known)) = views.split_first_mut().zip(reconstruction.views.first()) else {
        return Ok(());
    };
    let verified = Zip::from(known.fused.mean())
        .and(&known.support)
        .map_collect(|&z, &support| if support > 0 { z } else { 0.0 });
    for (view, &index) in others.iter_mut().zip(order.iter().skip(1)) {
        let fit = fit_exposure(reference, view, verified.view())?;
        view.image = fit.exposure.apply_to(&view.image).mapv(|value| value.clamp(0.0, 1.0));
        report.photographs[index].exposure = Some(fit.exposure);
    }
    Ok(())
}

struct Run<'r, 'c> {
    config: &'r Config,
    callback: &'r mut Callback<'c>,
}

impl Run<'_, '_> {
    fn notify(&mut self, event: &Event) -> ControlFlow<()> {
        (self.callback)(event)
    }

    fn begin(&mut self, stage: Stage) -> Result<Instant> {
        let iterations = self.config.refinement.iterations.min(1);
        match self.notify(&Event::Begin { stage, iteration: 0, iterations }) {
            ControlFlow::Continue(()) => Ok(Instant::now()),
            ControlFlow::Break(()) => Err(Error::Interrupted),
        }
    }
}
