//! What the photographs of a capture share, found once, and the refinement of each.

use crate::config::{Config, Order};
use crate::error::{Error, Result};
use crate::refinement::event::{Callback, Event, Stage, begin};
use crate::refinement::refine;
use crate::refinement::stages::Stages;
use crate::reports::Refinement;
use crate::reports::capture::CaptureReport;
use crate::reports::evidence::Evidence;
use crate::reports::prediction::Component;
use crate::scene::Scene;
use crate::several::cameras::Posed;
use crate::several::novel::Candidate;
use crate::several::{cameras, novel, priors, result, withheld};
use mde_fusion::BayesFuser;
use mde_mvs::consensus::{Reconstruction, ViewDepth, reconstruct};
use mde_mvs::exposure::{Exposure, fit_exposure};
use mde_mvs::poses::relative_covariance;
use mde_mvs::scale::{Scale, point_matches};
use mde_mvs::views::{MIN_OVERLAP, ViewScore, select_views, sharpness};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Matrix6, Point3};
use ndarray::{Array2, Array3, ArrayView2, Zip};
use std::time::Instant;

/// Least share of a photograph's own choice among those swept together for it to need no sweeps of its own.
const SHARED: f64 = 0.75;

/// A capture after the stages that its photographs share: predictions of the prior, poses, and plane sweeps of those that see the
/// same. [`PreparedScene::refine`] fits a field for any of them, in that photograph's own frustum.
///
/// All results have one unit: one factor between poses and prior, that of the capture's reference.
#[derive(Debug)]
pub struct PreparedScene<'s> {
    scene: &'s Scene,
    config: &'s Config,
    priors: Vec<Option<Array2<f32>>>,
    /// Nothing where no further photograph has a pose.
    posed: Option<Posed>,
    /// For each posed photograph the scores of the others and the group that is swept for it; of the first alone until another is
    /// refined.
    plan: Vec<Planned>,
    swept: Option<Swept>,
    /// Of the capture's points, or found by the sweeps of the reference's group.
    scale: Option<Scale>,
    /// Whether the first group has been swept; where that finds no scale, each group has its own.
    scale_sought: bool,
    report: CaptureReport,
}

/// Photographs by their places among the posed views.
#[derive(Debug)]
struct Planned {
    scores: Vec<ViewScore>,
    /// The photograph itself, then those chosen for it.
    own: Vec<usize>,
    /// Those whose sweeps are computed together.
    group: Vec<usize>,
}

impl Planned {
    /// Reports the scores of the others for the photograph at `place`. The fit has those that are chosen, and among those that are swept.
    fn report(&self, posed: &Posed, place: usize, report: &mut CaptureReport) {
        for score in &self.scores {
            let (view, used) = (&posed.views[score.view], score.chosen && self.group.contains(&score.view));
            report.photographs[posed.order[score.view]].take(score, used, view, &posed.views[place]);
        }
    }
}

/// The latest sweeps.
#[derive(Debug)]
struct Swept {
    group: Vec<usize>,
    reconstruction: Reconstruction,
    seconds: f64,
}

impl<'s> PreparedScene<'s> {
    /// Predictions and poses of all photographs, and the choice of those that are swept together. Of the stages, the prior and its limit of
    /// predictions at once are used.
    ///
    /// # Errors
    /// As [`refine_several`](super::refine_several).
    pub fn new(
        scene: &'s Scene,
        stages: &Stages<'_>,
        config: &'s Config,
        callback: &mut Callback<'_>,
    ) -> Result<Self> {
        config.validate()?;
        scene.validate()?;
        let iterations = config.refinement.iterations.min(1);
        let mut report = CaptureReport::new(scene.photographs.iter().map(|one| &*one.name), scene.reference);
        let start = begin(callback, Stage::Prior, 0, iterations)?;
        let priors = priors::predict(scene, stages, config, |done, total| {
            callback(&Event::Predicted { done, total })
        })?;
        report.seconds.prior = start.elapsed().as_secs_f64();

        let start = begin(callback, Stage::Poses, 0, iterations)?;
        let mut matched = |done, total| callback(&Event::Part { stage: Stage::Poses, done, total });
        let posed = cameras::posed(scene, &priors, config, &mut report, &mut matched)?;
        let (mut plan, mut scale) = (Vec::new(), None);
        if let Some(posed) = &posed {
            plan = self::plan(posed, &priors, config, 1)?;
            plan.iter().for_each(|first| first.report(posed, 0, &mut report));
            scale = scale_of_points(scene, posed, &priors)?;
        }
        report.seconds.poses = start.elapsed().as_secs_f64();
        Ok(Self { scene, config, priors, posed, plan, swept: None, scale, scale_sought: false, report })
    }

    /// The photographs.
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }

    /// The prior's depth of a photograph, `[height, width]`; 0 where missing.
    pub fn prior_depth(&self, photograph: usize) -> Option<&Array2<f32>> {
        self.priors.get(photograph)?.as_ref()
    }

    /// Report of predictions and poses.
    pub fn report(&self) -> &CaptureReport {
        &self.report
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

    /// Refines one photograph, as [`refine_several`](super::refine_several) does the reference. The result does not depend on which
    /// photographs were refined before.
    ///
    /// # Errors
    /// As [`refine_several`](super::refine_several), and [`Error::Capture`] for an index that is none of the photographs.
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
        let prior = prior.clone().ok_or(Error::EmptyPrior)?;
        let mut report = self.report.of(self.scene.reference, photograph);
        let config = self.config;
        let iterations = config.refinement.iterations.min(1);
        if photograph != self.scene.reference
            && let Some(posed) = &self.posed
            && self.plan.len() < posed.views.len()
        {
            self.plan = plan(posed, &self.priors, config, posed.views.len())?;
        }
        let place = match self.place(photograph) {
            Ok(place) => place,
            Err(reason) => {
                report.fallback = Some(reason);
                return self.alone(photograph, stages, report, callback);
            }
        };
        let Some(posed) = self.posed.as_ref() else { return Err(Error::EmptyPrior) };
        self.plan[place].report(posed, place, &mut report);

        begin(callback, Stage::Sweep, 0, iterations)?;
        self.sweep(place, &mut |done, total| callback(&Event::Part { stage: Stage::Sweep, done, total }))?;
        let (Some(posed), Some(swept)) = (&self.posed, &self.swept) else {
            return Err(Error::EmptyPrior);
        };
        let start = Instant::now();
        let group: Vec<usize> = swept.group.iter().map(|&view| posed.order[view]).collect();
        report.take(&swept.reconstruction, &group);
        let unit = posed.unit;
        let known = |view: usize| swept.group.iter().position(|&swept| swept == view);
        let known = |view: usize| &swept.reconstruction.views[known(view).unwrap_or(0)];
        let own = known(place);
        report.scale = Some(result::scale(&swept.reconstruction, unit));
        let plan = &self.plan[place];
        let members: Vec<usize> =
            plan.own.iter().copied().filter(|view| swept.group.contains(view)).collect();
        let mut views = members.iter().map(|&view| posed.views[view].clone()).collect::<Vec<_>>();
        let order: Vec<usize> = members.iter().map(|&view| posed.order[view]).collect();
        let from = posed.covariances[place].as_ref();
        let back = posed.views[place].pose.inverse();
        // The capture's reference, or given poses that are kept, have no covariance of their own.
        let relative = |&view: &usize| {
            let motion = posed.views[view].pose * back;
            let own = posed.covariances[view];
            (own.is_some() || from.is_some())
                .then(|| relative_covariance(&motion, &own.unwrap_or_else(Matrix6::zeros), from))
        };
        let covariances: Vec<Option<Matrix6<f64>>> = members.iter().map(relative).collect();
        let mut candidate = candidate(plan, posed, &swept.group);
        if place != 0 {
            let frame = views[0].pose.inverse();
            let others = candidate.iter_mut().map(|candidate| &mut candidate.view);
            views.iter_mut().chain(others).for_each(|view| view.pose *= frame);
        }
        let depths = priors::for_views(&views, &order, &self.priors, unit)?;
        let depths: Vec<ArrayView2<'_, f32>> = depths.iter().map(|depth| depth.view()).collect();
        report.withheld_colours =
            withheld::withheld(&views, &depths, &order, &swept.reconstruction, self.scene)?;
        if let Some(reason) = result::unusable(own).or_else(|| withheld::contradiction(&report)) {
            report.fallback = Some(reason);
            // What the refused sweeps found is no scale.
            report.scale = None;
            report.seconds.sweep = swept.seconds + start.elapsed().as_secs_f64();
            return self.alone(photograph, stages, report, callback);
        }
        equalise(&mut views, own, &order, &mut report)?;
        for (view, &member) in views.iter_mut().zip(&members) {
            view.hypotheses = vec![known(member).fused.clone()];
        }
        report.seconds.sweep = swept.seconds + start.elapsed().as_secs_f64();

        let (mut rendered, mut field) = (None, None);
        if config.refinement.iterations > 0 {
            let start = begin(callback, Stage::Fit, 0, iterations)?;
            let mut fitted = stages.field(config, 0)?;
            report.fit = Some(fitted.fit(&views, &mut |event: &mde_nerf::FieldEvent| {
                callback(&Event::Field { event: *event, view: 0, views: 0 })
            })?);
            report.seconds.fit = start.elapsed().as_secs_f64();

            let start = begin(callback, Stage::Render, 0, iterations)?;
            rendered = Some(fitted.render(
                &views[0].camera,
                &views[0].pose,
                &mut |event: &mde_nerf::FieldEvent| {
                    callback(&Event::Field { event: *event, view: 0, views: 1 })
                },
            )?);
            report.seconds.render = start.elapsed().as_secs_f64();
            if let Some(candidate) = &mut candidate {
                if !candidate.withheld {
                    // In the exposure of the fit.
                    let at = order.iter().position(|index| *index == candidate.index);
                    candidate.view = at.map_or_else(|| candidate.view.clone(), |at| views[at].clone());
                }
                let mut notify = |event: &mde_nerf::FieldEvent| {
                    callback(&Event::Field { event: *event, view: 1, views: 2 })
                };
                report.novel = Some(novel::compare(candidate, &views[0], own, &*fitted, &mut notify)?);
            }
            field = Some(fitted);
        }
        begin(callback, Stage::Fuse, 0, iterations)?;
        let factor = result::scale(&swept.reconstruction, unit)[0];
        let inflation = swept.reconstruction.inflation;
        let (mut depth, mut components) =
            result::combine(own, inflation, &views, &covariances, rendered.as_ref(), factor)?;
        if let Some(rendered) = &rendered {
            let printed = match (stages.fuser, config.refinement.order) {
                (Some(fuser), _) => Some(result::printed(fuser, &prior, rendered, factor)?),
                (None, Order::Paper) => {
                    Some(result::printed(&BayesFuser::new(config.fusion.clone())?, &prior, rendered, factor)?)
                }
                (None, Order::Poses) => None,
            };
            if let Some(fused) = printed {
                components = vec![Component { name: "field", sigma: fused.aligned.sigma() }];
                report.fusion = Some(fused.report);
                depth = fused.depth;
            }
        }
        report.place(&views, &order, factor);
        let fused: Vec<&GaussianDepth> = members.iter().map(|&member| &known(member).fused).collect();
        let evidence = Evidence::new(&views, &fused, rendered.as_ref(), &depth, factor)?;
        report.confirmed = Some(evidence.confirmed_share());
        report.evidence = Some(evidence);
        Ok(Refinement { depth, components, field, capture: Some(report), ..Refinement::of_prior(prior) })
    }

    /// Its place among the posed views, or why it has none.
    fn place(&self, photograph: usize) -> std::result::Result<usize, String> {
        let Some(posed) = &self.posed else {
            return Err(self
                .report
                .fallback
                .clone()
                .unwrap_or_else(|| "no photograph has a pose".to_owned()));
        };
        let verdict = || format!("no pose: {}", self.report.photographs[photograph].verdict);
        let place = posed.order.iter().position(|&index| index == photograph).ok_or_else(verdict)?;
        if self.plan[place].own.len() < 2 {
            return Err("no photograph shows the reference's scene from another place".to_owned());
        }
        Ok(place)
    }

    /// Sweeps of the group in which that view is, unless they are the latest.
    fn sweep(&mut self, place: usize, swept: &mut mde_mvs::Callback<'_>) -> Result<()> {
        let same = |swept: &Swept| swept.group == self.plan[place].group;
        if self.swept.as_ref().is_some_and(same) {
            if let Some(swept) = &mut self.swept {
                swept.seconds = 0.0;
            }
            return Ok(());
        }
        // One scale for all: that of the first group, which is the reference's unless nothing shows its scene.
        let first = self.plan.iter().position(|planned| planned.own.len() > 1).unwrap_or(0);
        let is_first = self.plan[place].group == self.plan[first].group;
        if self.scale.is_none() && !self.scale_sought && !is_first {
            self.sweep(first, swept)?;
        }
        let Some(posed) = &self.posed else { return Ok(()) };
        self.swept = None;
        let start = Instant::now();
        let group = self.plan[place].group.clone();
        let order: Vec<usize> = group.iter().map(|&view| posed.order[view]).collect();
        let views: Vec<PosedView> = group.iter().map(|&view| posed.views[view].clone()).collect();
        let depths = priors::for_views(&views, &order, &self.priors, posed.unit)?;
        let depths: Vec<ArrayView2<'_, f32>> = depths.iter().map(|depth| depth.view()).collect();
        let reconstruction = reconstruct(&views, &depths, self.scale, swept)?;
        if is_first {
            self.scale = self.scale.or(reconstruction.scale);
            self.scale_sought = true;
        }
        self.swept = Some(Swept { group, reconstruction, seconds: start.elapsed().as_secs_f64() });
        Ok(())
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
                "{}: {reason}; one photograph alone needs a depth network: give {{prior-model}}",
                reference.name
            )));
        }
        let refined =
            refine(reference.image.view(), &reference.camera.camera, stages, self.config, callback)?;
        Ok(Refinement { capture: Some(report), ..refined })
    }
}

/// The scale by the points that the capture's reference shows.
fn scale_of_points(scene: &Scene, posed: &Posed, priors: &[Option<Array2<f32>>]) -> Result<Option<Scale>> {
    let reference = scene.reference;
    let (Some(pose), Some(prior)) = (scene.photographs[reference].pose, &priors[reference]) else {
        return Ok(None);
    };
    // The posed views have the reference's frame for their world.
    let points: Vec<Point3<f64>> = scene.points.iter().map(|point| pose * point).collect();
    let prior = prior.mapv(|z| (f64::from(z) * posed.unit) as f32);
    Ok(Scale::fit(&point_matches(&posed.views[0], &points, prior.view())?))
}

/// The best of the photographs that are not swept; else the least needed of the chosen, which the fit has then.
fn candidate(plan: &Planned, posed: &Posed, swept: &[usize]) -> Option<Candidate> {
    let overlaps = |score: &&ViewScore| score.overlap >= MIN_OVERLAP && score.score > 0.0;
    let is_swept = |score: &&ViewScore| swept.contains(&score.view);
    let spare = plan.scores.iter().filter(|score| !is_swept(score)).find(overlaps);
    let score = spare.or_else(|| plan.scores.iter().rfind(|score| score.chosen && is_swept(score)))?;
    Some(Candidate {
        view: posed.views[score.view].clone(),
        index: posed.order[score.view],
        withheld: !is_swept(&score),
    })
}

/// The best photographs for each by parallax, overlap and sharpness, and the groups of those that are swept together: every group is
/// the choice of one photograph, and serves those of its members whose own choice it nearly is. Only the first `count` are planned.
fn plan(
    posed: &Posed,
    priors: &[Option<Array2<f32>>],
    config: &Config,
    count: usize,
) -> Result<Vec<Planned>> {
    let max_views = config.multi_view.max_views.saturating_sub(1);
    let sharpness = sharpness(&posed.views);
    let mut plan = Vec::new();
    for (place, &index) in posed.order.iter().enumerate().take(count) {
        let mut own = vec![place];
        let mut scores = Vec::new();
        if let Some(prior) = &priors[index] {
            let depth = prior.mapv(|z| (f64::from(z) * posed.unit) as f32);
            scores = select_views(&posed.views, place, depth.view(), &sharpness, max_views)?;
            let mut chosen: Vec<usize> = scores.iter().filter(|s| s.chosen).map(|s| s.view).collect();
            chosen.sort_unstable();
            own.extend(chosen);
        }
        plan.push(Planned { scores, own, group: Vec::new() });
    }
    for place in 0..plan.len() {
        let group = plan[place].own.clone();
        if !plan[place].group.is_empty() || group.len() < 2 {
            continue;
        }
        for &member in &group {
            let Some(own) = plan.get(member).map(|planned| &planned.own) else { continue };
            let here = own.iter().filter(|view| group.contains(view)).count();
            if plan[member].group.is_empty() && here >= 2 && here as f64 >= SHARED * own.len() as f64 {
                plan[member].group.clone_from(&group);
            }
        }
    }
    Ok(plan)
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
        view.image = image;
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
    let exposure = fit_exposure(reference, view, verified.view())?.exposure;
    let image = exposure.apply_to(&view.image).mapv(|value| value.clamp(0.0, 1.0));
    Ok((exposure, image))
}
