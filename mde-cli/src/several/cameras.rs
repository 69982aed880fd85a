//! Poses and cameras of the photographs, refined or estimated.

use crate::config::Config;
use crate::error::Result;
use crate::reports::capture::{CaptureReport, PoseSource};
use crate::scene::Scene;
use mde_mvs::poses::{
    EstimatedPose, PoseCovariance, PoseInput, Prepared, Verdict, estimate_poses, max_features, refine_poses,
};
use mde_mvs::views::gradient_energy;
use mde_uncertainty::random::derived_seed;
use mde_uncertainty::statistics::median;
use mde_warp::{Pose, PosedView};
use nalgebra::Point2;
use ndarray::ArcArray2;
use rayon::prelude::*;

/// Logarithm of the factor by which a photograph of a walk is nearer its scene, or farther, than the reference: 1.5. Within it one depth for
/// all serves as well (13 captures of one place: AbsRel 1.009 with its own for each).
const ELSEWHERE: f64 = 0.405;

/// The photographs with a pose, in the frame of the capture's reference.
#[derive(Debug, Default)]
pub(super) struct Posed {
    /// That reference first, with empty images.
    pub(super) views: Vec<PosedView>,
    /// Index of each view among the photographs.
    pub(super) order: Vec<usize>,
    /// [`gradient_energy`] of each view.
    pub(super) energies: Vec<f64>,
    /// Covariance of the photographs' poses.
    pub(super) covariance: PoseCovariance,
    /// Unit of the poses per unit of the prior: the prior's depth times this is in the unit of the poses.
    pub(super) unit: f64,
    /// Further factor of each view's prior: of one depth everywhere, to the typical depth of that view's matches where it is [`ELSEWHERE`].
    pub(super) own: Vec<f64>,
}

impl Posed {
    /// The view at that place, with its image.
    pub(super) fn read(&self, scene: &Scene, place: usize) -> Result<PosedView> {
        let image = scene.photographs[self.order[place]].image.read()?;
        Ok(PosedView { image, ..self.views[place].clone() })
    }
}

/// The posed views, or nothing (with the reason in the report) where no photograph but the reference has a pose with parallax. The
/// callback counts the pairs of photographs as they are matched.
pub(super) fn posed(
    scene: &Scene,
    priors: &[Option<ArcArray2<f32>>],
    config: &Config,
    report: &mut CaptureReport,
    matched: &mut mde_mvs::Callback<'_>,
) -> Result<Option<Posed>> {
    let most = max_features(scene.photographs.len(), scene.is_posed());
    let prepare = |index: usize| {
        let photograph = &scene.photographs[index];
        let image = photograph.image.read()?;
        let input = PoseInput {
            image: image.view(),
            camera: photograph.camera.camera,
            focal_assumed: photograph.camera.is_assumed() && photograph.pose.is_none(),
            prior: priors[index].as_ref(),
        };
        Ok((Prepared::new(&input, most)?, gradient_energy(image.view())))
    };
    let prepared = (0..priors.len()).into_par_iter().map(prepare);
    let (inputs, energies) = prepared.collect::<Result<(Vec<_>, Vec<_>)>>()?;
    let seed = derived_seed(config.seed, "poses", 0);
    let given: Option<Vec<Pose>> = scene.photographs.iter().map(|p| p.pose).collect();
    let (mut depths, reference) = (Vec::new(), (!scene.every).then_some(0));
    let (mut found, covariance) = if let Some(given) = given {
        let world = given[0].inverse();
        let given: Vec<Pose> = given.iter().map(|pose| pose * world).collect();
        let refined = refine_poses(&inputs, &given, reference, seed, matched)?;
        report.poses = if refined.accepted { PoseSource::Refined } else { PoseSource::Given };
        report.withheld_pixels = refined.withheld;
        let moved = refined.moved.iter().map(|&index| scene.photographs[index].name.clone());
        report.moved = moved.collect();
        depths = refined.depths;
        (refined.photographs, refined.covariance)
    } else {
        let estimated = estimate_poses(&inputs, reference, seed, matched)?;
        report.poses = PoseSource::Estimated;
        report.focal_factor = Some(estimated.focal_factor);
        report.focal_sigma = estimated.focal_sigma;
        report.distortion = estimated.distortion;
        (estimated.photographs, estimated.covariance)
    };
    for (photograph, found) in report.photographs.iter_mut().zip(&found) {
        (photograph.verdict, photograph.matches) = (found.verdict.to_string(), Some(found.matches));
    }
    let reference = found.iter().position(|found| found.verdict == Verdict::Reference).unwrap_or(0);
    report.photographs[reference].used = true;
    let verdict = &found[reference].verdict;
    if !verdict.has_pose() {
        // Nothing tells which of the others could be right.
        let own = format!("{}: {verdict}", report.photographs[reference].name);
        let (count, without) = (found.len(), found.iter().filter(|one| !one.verdict.has_pose()).count());
        let most = format!(
            "{without} of {count} photographs do not fit their poses ({own}); check that these are camera to world, with the axes of their format"
        );
        report.fallback = Some(if 2 * without > count { most } else { own });
        return Ok(None);
    }
    let useful = |found: &EstimatedPose| match report.poses {
        PoseSource::Estimated => found.verdict == Verdict::Posed,
        _ => found.verdict.has_pose(),
    };
    let others = (0..found.len()).filter(|&index| index != reference);
    if !others.clone().any(|index| useful(&found[index])) {
        report.fallback = Some(report.verdicts(reference));
        return Ok(None);
    }
    let world = found[reference].pose.filter(|_| reference != 0).map(|pose| pose.inverse());
    let moved = found.iter_mut().filter_map(|one| one.pose.as_mut().zip(world));
    moved.for_each(|(pose, world)| *pose *= world);
    let unit = unit_of(&depths, priors[reference].as_ref());
    let flat = priors[reference].as_ref().and_then(|prior| {
        let first = *prior.first()?;
        prior.iter().all(|z| *z == first).then_some(f64::from(first) * unit)
    });
    let mut posed = Posed { unit, covariance, ..Posed::default() };
    let (mut centres, mut known) = (Vec::new(), Vec::new());
    for index in std::iter::once(reference).chain(others) {
        if let EstimatedPose { pose: Some(pose), camera, depth, .. } = found[index] {
            posed.views.push(scene.photographs[index].place(pose, camera));
            posed.order.push(index);
            posed.energies.push(energies[index]);
            centres.push(pose.inverse().translation.vector);
            known.extend(depth.zip(flat).map(|(depth, flat)| (centres.len() - 1, depth / flat)));
        }
    }
    // One with too few points has the depth of the nearest other.
    posed.own.extend(centres.iter().map(|at| {
        let distance = |(place, _): &&(usize, f64)| (centres[*place] - at).norm();
        let nearest = known.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map(|(_, own)| *own).filter(|own| own.ln().abs() > ELSEWHERE).unwrap_or(1.0)
    }));
    Ok(Some(posed))
}

/// The robust factor from the reference's prior to its depths by matches; 1 without any.
fn unit_of(depths: &[(Point2<f64>, f64)], prior: Option<&ArcArray2<f32>>) -> f64 {
    let Some(prior) = prior else { return 1.0 };
    let logs = depths.iter().filter_map(|(pixel, depth)| {
        let known = *prior.get((pixel.y.round() as usize, pixel.x.round() as usize)).filter(|z| **z > 0.0)?;
        (*depth > 0.0).then(|| (depth / f64::from(known)).ln())
    });
    median(logs).map_or(1.0, f64::exp)
}
