//! What the photographs of a capture share, found once, and the refinement of each.

use crate::config::{Config, Order};
use crate::error::{Error, Result, text};
use crate::refinement::event::{Callback, Event, Stage, begin, of_field};
use crate::refinement::refine;
use crate::refinement::stages::Stages;
use crate::reports::Refinement;
use crate::reports::capture::CaptureReport;
use crate::reports::prediction::Component;
use crate::scene::Scene;
use crate::several::cameras::Posed;
use crate::several::novel::Candidate;
use crate::several::{cameras, novel, priors, result, withheld};
use mde_fusion::{BayesFuser, Fuser};
use mde_mvs::consensus::{Reconstruction, Sweeps, ViewDepth};
use mde_mvs::evidence::Evidence;
use mde_mvs::exposure::{Exposure, fit_exposure};
use mde_mvs::scale::{Scale, point_matches};
use mde_mvs::sigma::{COMPONENTS, combine};
use mde_mvs::views::{MIN_OVERLAP, ViewScore, keyframes, select_views};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::Point3;
use ndarray::{ArcArray2, Array2, Array3, Zip};
use rayon::prelude::*;

/// A capture after the stages that its photographs share: predictions of the prior, poses, and plane sweeps, each computed when a
/// photograph first needs it. [`PreparedScene::refine`] fits a field for any of them, in that photograph's own frustum.
///
/// All results have one unit: one factor between poses and prior, that of the capture's reference.
#[derive(Debug)]
pub struct PreparedScene<'s> {
    scene: &'s Scene,
    config: &'s Config,
    priors: Vec<Option<ArcArray2<f32>>>,
    /// Nothing where no further photograph has a pose.
    posed: Option<Posed>,
    /// For each posed photograph.
    plan: Vec<Planned>,
    /// Nothing before the first sweep.
    sweeps: Option<Sweeps>,
    /// Of the capture's points.
    scale: Option<Scale>,
    report: CaptureReport,
    once: bool,
}

/// Photographs by their places among the posed views.
#[derive(Debug)]
struct Planned {
    scores: Vec<ViewScore>,
    /// The photograph itself, then those chosen for it.
    own: Vec<usize>,
}

impl Planned {
    /// Reports the scores of the others for the photograph at `place`.
    fn report(&self, posed: &Posed, place: usize, report: &mut CaptureReport) {
        for score in &self.scores {
            let view = &posed.views[score.view];
            report.photographs[posed.order[score.view]].take(score, score.chosen, view, &posed.views[place]);
        }
    }
}

impl<'s> PreparedScene<'s> {
    /// Predictions and poses of all photographs, and the choice of those that are swept together. Of the stages, the prior and its limit of
    /// predictions at once are used.
    ///
    /// # Errors
    /// The error of a stage, and [`Error::Capture`] for photographs that [`Scene::several`] refuses.
    pub fn new(
        scene: &'s Scene,
        stages: &Stages<'_>,
        config: &'s Config,
        callback: &mut Callback<'_>,
    ) -> Result<Self> {
        config.validate()?;
        scene.validate()?;
        let iterations = config.refinement.iterations.min(1);
        let mut report = CaptureReport::new(scene.photographs.iter().map(|one| &*one.name));
        let start = begin(callback, Stage::Prior, 0, iterations)?;
        let priors = priors::predict(scene, stages, config, |done, total| {
            callback(&Event::Part { stage: Stage::Prior, done, total })
        })?;
        report.seconds.prior = start.elapsed().as_secs_f64();

        let start = begin(callback, Stage::Poses, 0, iterations)?;
        let mut matched = |done, total| callback(&Event::Part { stage: Stage::Poses, done, total });
        let posed = cameras::posed(scene, &priors, config, &mut report, &mut matched)?;
        let (mut plan, mut scale) = (Vec::new(), None);
        if let Some(posed) = &posed {
            plan = self::plan(posed, &priors, config)?;
            plan[0].report(posed, 0, &mut report);
            scale = scale_of_points(scene, posed, &priors)?;
        }
        report.seconds.poses = start.elapsed().as_secs_f64();
        Ok(Self { scene, config, priors, posed, plan, sweeps: None, scale, report, once: false })
    }

    /// For one result at most: what only further ones would need is dropped, now and on the way.
    #[must_use]
    pub fn once(self) -> Self {
        Self { once: true, sweeps: None, ..self }
    }

    /// The photographs.
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }

    /// The prior's depth of a photograph, `[height, width]`; 0 where missing.
    pub fn prior_depth(&self, photograph: usize) -> Option<&ArcArray2<f32>> {
        self.priors.get(photograph)?.as_ref()
    }

    /// Report of predictions and poses.
    pub fn report(&self) -> &CaptureReport {
        &self.report
    }

    /// Index of the photograph whose frame is that of the poses.
    pub fn reference(&self) -> usize {
        self.posed.as_ref().map_or(0, |posed| posed.order[0])
    }

    /// The camera of a photograph, with the estimated focal length where that was assumed; none for an index that is none of them.
    pub fn camera(&self, photograph: usize) -> Option<PinholeCamera> {
        let own = || Some(self.scene.photographs.get(photograph)?.camera.camera);
        self.view(photograph).map(|view| view.camera).or_else(own)
    }

    /// From the frame of the capture's reference to that of a photograph, in the unit of the poses.
    pub fn pose(&self, photograph: usize) -> Option<Pose> {
        self.view(photograph).map(|view| view.pose)
    }

    fn view(&self, photograph: usize) -> Option<&PosedView> {
        let posed = self.posed.as_ref()?;
        let place = posed.order.iter().position(|&index| index == photograph)?;
        posed.views.get(place)
    }

    /// Refines the depth of one photograph with the parallax of the others. Depth and sigma are `[height, width]`, z in the prior's unit. Where
    /// the photographs carry no depth (no common scene, no parallax, hardly anything verified, or a withheld photograph that the prior
    /// explains better), the result is that of [`refine`] without a field for the photograph alone, and [`CaptureReport::fallback`] has the
    /// reason. It does not depend on which photographs were refined before.
    ///
    /// # Errors
    /// Those of [`new`](Self::new) and of [`refine`], and [`Error::Capture`] for an index that is none of the photographs.
    pub fn refine(
        &mut self,
        photograph: usize,
        mut stages: Stages<'_>,
        callback: &mut Callback<'_>,
    ) -> Result<Refinement> {
        let Some(prior) = self.priors.get(photograph) else {
            let reason = format!("photograph {photograph} of {}", self.priors.len());
            return Err(Error::Capture { reason, remedy: "give the index of one of them" });
        };
        let prior = prior.as_ref().ok_or(Error::EmptyPrior)?.to_owned();
        let mut report = self.report.of(photograph);
        let config = self.config;
        let iterations = config.refinement.iterations.min(1);
        let place = match self.place(photograph) {
            Ok(place) => place,
            Err(reason) => {
                report.fallback = Some(reason);
                return self.alone(photograph, stages, report, callback);
            }
        };
        let Some(posed) = self.posed.as_ref() else { return Err(Error::EmptyPrior) };
        self.plan[place].report(posed, place, &mut report);

        let start = begin(callback, Stage::Sweep, 0, iterations)?;
        let members = self.plan[place].own.clone();
        let swept = &mut |done, total| callback(&Event::Part { stage: Stage::Sweep, done, total });
        let (reconstruction, priors) = self.reconstruct(&members, swept)?;
        if self.once {
            self.sweeps = None;
        }
        let Some(posed) = &self.posed else { return Err(Error::EmptyPrior) };
        let order: Vec<usize> = members.iter().map(|&view| posed.order[view]).collect();
        report.take(&reconstruction, &order);
        let unit = posed.unit;
        let scale = result::scale(&reconstruction, unit);
        report.scale = Some(scale);
        let plan = &self.plan[place];
        let views = members.iter().map(|&view| posed.read(self.scene, view));
        let mut views = views.collect::<Result<Vec<_>>>()?;
        let poses: Vec<_> = members.iter().map(|&view| (posed.order[view], posed.views[view].pose)).collect();
        let covariance = posed.covariance.of_motions(&poses);
        let mut candidate = candidate(plan, posed, self.scene)?;
        if place != 0 {
            let frame = views[0].pose.inverse();
            let others = candidate.iter_mut().map(|candidate| &mut candidate.view);
            views.iter_mut().chain(others).for_each(|view| view.pose *= frame);
        }
        let unused = candidate.as_ref().filter(|candidate| candidate.withheld);
        report.withheld_colours =
            withheld::withheld(&views, priors, &order, &reconstruction, unused, self.scene)?;
        // Of the others the consensus alone is needed from here on.
        let Reconstruction { views: mut known, inflation, .. } = reconstruction;
        let others: Vec<GaussianDepth> = known.drain(1..).map(|known| known.fused).collect();
        let own = &known[0];
        if let Some(reason) = result::unusable(own).or_else(|| withheld::contradiction(&report)) {
            report.fallback = Some(reason);
            // What the refused sweeps found is no scale.
            report.scale = None;
            report.seconds.sweep = start.elapsed().as_secs_f64();
            return self.alone(photograph, stages, report, callback);
        }
        let fused: Vec<&GaussianDepth> = std::iter::once(&own.fused).chain(&others).collect();
        equalise(&mut views, own, &order, &mut report)?;
        report.seconds.sweep = start.elapsed().as_secs_f64();

        let (mut rendered, mut field) = (None, None);
        if config.refinement.iterations > 0 {
            let start = begin(callback, Stage::Fit, 0, iterations)?;
            let mut fitted = stages.field(config, 0)?;
            views.iter_mut().zip(&fused).for_each(|(view, fused)| view.hypotheses.push((*fused).clone()));
            report.fit = Some(fitted.fit(&views, &mut of_field(callback, 0, 0))?);
            views.iter_mut().for_each(|view| view.hypotheses.clear());
            report.seconds.fit = start.elapsed().as_secs_f64();

            let start = begin(callback, Stage::Render, 0, iterations)?;
            rendered =
                Some(fitted.render(&views[0].camera, &views[0].pose, &mut of_field(callback, 0, 1))?);
            report.seconds.render = start.elapsed().as_secs_f64();
            if let Some(candidate) = &mut candidate {
                if !candidate.withheld {
                    // In the exposure of the fit.
                    let at = order.iter().position(|index| *index == candidate.index);
                    candidate.view = at.map_or_else(|| candidate.view.clone(), |at| views[at].clone());
                }
                let mut listen = of_field(callback, 1, 2);
                report.novel = Some(novel::compare(candidate, &views[0], own, &*fitted, &mut listen)?);
            }
            field = Some(fitted);
        }
        begin(callback, Stage::Fuse, 0, iterations)?;
        let factor = scale[0];
        let of_field = rendered.as_ref().map(|rendered| (&rendered.depth, rendered.in_bin.as_ref()));
        let (mut depth, parts) = combine(own, inflation, &views, &covariance, of_field, factor)?;
        let of_part = |(name, sigma)| Component { name, sigma };
        let mut components: Vec<_> = COMPONENTS.into_iter().zip(parts).map(of_part).collect();
        let bayes = BayesFuser::new(config.fusion.clone())?;
        let usual = (config.refinement.order == Order::Paper).then_some(&bayes as &dyn Fuser);
        if let Some((rendered, fuser)) = rendered.as_ref().zip(stages.fuser.or(usual)) {
            let fused = result::printed(fuser, &prior, rendered, factor)?;
            components = vec![Component { name: "field", sigma: fused.aligned.sigma() }];
            report.fusion = Some(fused.report);
            depth = fused.depth;
        } else {
            depth = result::refined(&depth, &mut components, &views, &others, factor)?;
        }
        report.place(&views, &order, factor);
        let evidence =
            Evidence::new(&views, &fused, rendered.as_ref().map(|rendered| &rendered.depth), &depth, factor)?;
        if report.fusion.is_none() {
            let factor = evidence.sigma_factor(&depth, prior.view());
            depth = result::with_sigma(depth, &mut components, &factor)?;
        }
        report.confirmed = Some(evidence.confirmed_share());
        report.evidence = Some(evidence);
        Ok(Refinement { depth, components, field, capture: Some(report), ..Refinement::of_prior(prior) })
    }

    /// Its place among the posed views, or why it has none.
    fn place(&self, photograph: usize) -> std::result::Result<usize, String> {
        let Some(posed) = &self.posed else { return Err(self.report.fallback.clone().unwrap_or_default()) };
        let verdict = || format!("no pose: {}", self.report.photographs[photograph].verdict);
        let place = posed.order.iter().position(|&index| index == photograph).ok_or_else(verdict)?;
        if self.plan[place].own.len() < 2 {
            return Err("no photograph shows the reference's scene from another place".to_owned());
        }
        Ok(place)
    }

    /// Depths of those posed views from each other and their own sources, and their priors in the unit of the poses.
    fn reconstruct(
        &mut self,
        members: &[usize],
        swept: &mut mde_mvs::Callback<'_>,
    ) -> Result<(Reconstruction, Vec<Array2<f32>>)> {
        let Some(posed) = &self.posed else { return Err(Error::EmptyPrior) };
        let (priors, scene) = (&self.priors, self.scene);
        let prior = |view: usize| priors::in_unit_of_poses(posed, priors, view);
        let fault = |error: Error| mde_mvs::Error::Photograph(text(&error));
        let read = |view: usize| posed.read(scene, view).map_err(fault);
        if self.sweeps.is_none() {
            let mut sweeps = Sweeps::new(&read, &prior, sources(&self.plan))?;
            sweeps.scale = self.scale;
            if self.scale.is_none() {
                // One scale for all: by the reference and its choice, unless nothing shows its scene.
                let first = self.plan.iter().position(|planned| planned.own.len() > 1).unwrap_or(0);
                sweeps.find_scale(&self.plan[first].own)?;
            }
            self.sweeps = Some(sweeps);
        }
        let Some(sweeps) = &mut self.sweeps else { return Err(Error::EmptyPrior) };
        let found = sweeps.reconstruct(&read, &prior, members, swept)?;
        Ok((found, members.iter().map(|&view| prior(view)).collect()))
    }

    /// The photograph alone, with the same settings.
    fn alone(
        &self,
        photograph: usize,
        stages: Stages<'_>,
        report: CaptureReport,
        callback: &mut Callback<'_>,
    ) -> Result<Refinement> {
        let reference = &self.scene.photographs[photograph];
        if let (false, Some(reason)) = (stages.serves_one, &report.fallback) {
            return Err(Error::Argument(format!(
                "{reason}; one photograph alone needs a depth network: give {{prior-model}}"
            )));
        }
        let (image, camera) = (reference.image.read()?, &reference.camera.camera);
        let refined = refine(image.view(), camera, stages, self.config, callback)?;
        Ok(Refinement { capture: Some(report), ..refined })
    }
}

/// The scale by the points that the first photograph shows, where it is the reference.
fn scale_of_points(scene: &Scene, posed: &Posed, priors: &[Option<ArcArray2<f32>>]) -> Result<Option<Scale>> {
    let Some(pose) = scene.photographs[0].pose.filter(|_| posed.order[0] == 0) else { return Ok(None) };
    // The posed views have the reference's frame for their world.
    let points: Vec<Point3<f64>> = scene.points.iter().map(|point| pose * point).collect();
    let prior = priors::in_unit_of_poses(posed, priors, 0);
    Ok(Scale::fit(&point_matches(&posed.read(scene, 0)?, &points, prior.view())?))
}

/// The best of the photographs that are not chosen; else the least needed of the chosen, which the fit has then.
fn candidate(plan: &Planned, posed: &Posed, scene: &Scene) -> Result<Option<Candidate>> {
    let overlaps = |score: &&ViewScore| score.overlap >= MIN_OVERLAP && score.score > 0.0;
    let spare = plan.scores.iter().filter(|score| !score.chosen).find(overlaps);
    let score = spare.or_else(|| plan.scores.iter().rfind(|score| score.chosen));
    let of = |score: &ViewScore| {
        let (view, index) = (posed.read(scene, score.view)?, posed.order[score.view]);
        Ok(Candidate { view, index, withheld: !score.chosen })
    };
    score.map(of).transpose()
}

/// The best photographs for each by parallax, overlap and sharpness.
fn plan(posed: &Posed, priors: &[Option<ArcArray2<f32>>], config: &Config) -> Result<Vec<Planned>> {
    let max_views = config.multi_view.max_views.saturating_sub(1);
    let everyone = || (0..posed.views.len()).into_par_iter();
    let median_depth = |place| {
        let depth = priors::in_unit_of_poses(posed, priors, place);
        median(depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z))).unwrap_or(0.0)
    };
    let medians: Vec<f64> = everyone().map(median_depth).collect();
    let poses: Vec<Pose> = posed.views.iter().map(|view| view.pose).collect();
    let keyframes = keyframes(&poses, &medians, &posed.energies);
    let of = |place: usize| {
        let depth = priors::in_unit_of_poses(posed, priors, place);
        let scores = select_views(&posed.views, place, depth.view(), &posed.energies, &keyframes, max_views)?;
        let mut own: Vec<usize> =
            scores.iter().filter(|score| score.chosen).map(|score| score.view).collect();
        own.sort_unstable();
        own.insert(0, place);
        Ok(Planned { scores, own })
    };
    everyone().map(of).collect()
}

/// What each photograph is swept against: those chosen for it; where there are none, those that chose it.
fn sources(plan: &[Planned]) -> Vec<Vec<usize>> {
    let of = |(place, planned): (usize, &Planned)| {
        let mut sources = planned.own.clone();
        if sources.len() < 2 {
            let chose_it = |other: &usize| *other != place && plan[*other].own.contains(&place);
            sources.extend((0..plan.len()).filter(chose_it));
        }
        sources.sort_unstable();
        sources
    };
    plan.iter().enumerate().map(of).collect()
}

/// The photographs in the exposure of the first, fitted where other photographs confirm its depth.
fn equalise(
    views: &mut [PosedView],
    known: &ViewDepth,
    order: &[usize],
    report: &mut CaptureReport,
) -> Result<()> {
    let Some((reference, others)) = views.split_first_mut() else { return Ok(()) };
    for (view, &index) in others.iter_mut().zip(order.iter().skip(1)) {
        let (exposure, image) = equalised(reference, view, known)?;
        view.image = image.into_shared();
        report.photographs[index].exposure = Some(exposure);
    }
    Ok(())
}

/// The exposure of a photograph against the reference's, and its image in that of the reference.
pub(super) fn equalised(
    reference: &PosedView,
    view: &PosedView,
    known: &ViewDepth,
) -> Result<(Exposure, Array3<f32>)> {
    let verified = Zip::from(known.fused.mean())
        .and(&known.agreement.agree)
        .map_collect(|&z, &support| if support > 0 { z } else { 0.0 });
    let exposure = fit_exposure(reference, view, verified.view())?;
    let image = exposure.apply_to(view.image.view()).mapv(|value| value.clamp(0.0, 1.0));
    Ok((exposure, image))
}
