//! Poses and cameras of the photographs, refined or estimated.

use crate::config::Config;
use crate::error::Result;
use crate::reports::capture::{CaptureReport, PoseSource};
use crate::scene::Scene;
use mde_mvs::poses::{self, EstimatedPose, Verdict, estimate_poses, refine_poses};
use mde_uncertainty::random::derived_seed;
use mde_uncertainty::statistics::median;
use mde_warp::{Pose, PosedView};
use nalgebra::{Matrix6, Point2};
use ndarray::Array2;

/// The photographs with a pose, in the frame of the capture's reference.
#[derive(Debug)]
pub(super) struct Posed {
    /// That reference first.
    pub(super) views: Vec<PosedView>,
    /// Index of each view among the photographs.
    pub(super) order: Vec<usize>,
    /// Covariance of each view's pose, from the capture's reference; none where too few matches determine it.
    pub(super) covariances: Vec<Option<Matrix6<f64>>>,
    /// Unit of the poses per unit of the prior: the prior's depth times this is in the unit of the poses.
    pub(super) unit: f64,
}

/// The posed views, or nothing (with the reason in the report) where no photograph but the reference has a pose with parallax. The
/// callback counts the pairs of photographs as they are matched.
pub(super) fn posed(
    scene: &Scene,
    priors: &[Option<Array2<f32>>],
    config: &Config,
    report: &mut CaptureReport,
    matched: &mut mde_mvs::Callback<'_>,
) -> Result<Option<Posed>> {
    let inputs: Vec<poses::PoseInput<'_>> = scene
        .photographs
        .iter()
        .zip(priors)
        .map(|(photograph, prior)| poses::PoseInput {
            image: photograph.image.view(),
            camera: photograph.camera.camera,
            focal_assumed: photograph.camera.is_assumed() && photograph.pose.is_none(),
            prior: prior.as_ref().map(|depth| depth.view()),
        })
        .collect();
    let seed = derived_seed(config.seed, "poses", 0);
    let reference = scene.reference;
    let given: Option<Vec<Pose>> = scene.photographs.iter().map(|p| p.pose).collect();
    let mut unit = 1.0;
    let found = if let Some(given) = given {
        let world = given[reference].inverse();
        let given: Vec<Pose> = given.iter().map(|pose| pose * world).collect();
        let refined = refine_poses(&inputs, &given, reference, seed, matched)?;
        report.poses = if refined.accepted { PoseSource::Refined } else { PoseSource::Given };
        report.withheld_pixels = refined.withheld;
        unit = unit_of(&refined.depths, priors[reference].as_ref());
        refined.photographs
    } else {
        let estimated = estimate_poses(&inputs, reference, seed, matched)?;
        report.poses = PoseSource::Estimated;
        report.focal_factor = Some(estimated.focal_factor);
        estimated.photographs
    };
    for (photograph, found) in report.photographs.iter_mut().zip(&found) {
        (photograph.verdict, photograph.matches) = (found.verdict.to_string(), Some(found.matches));
    }
    let verdict = &found[reference].verdict;
    if !verdict.has_pose() {
        // Nothing tells which of the others could be right.
        report.fallback = Some(format!("{}: {verdict}", report.photographs[reference].name));
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
    let mut posed = Posed { views: Vec::new(), order: Vec::new(), covariances: Vec::new(), unit };
    for index in std::iter::once(reference).chain(others) {
        if let EstimatedPose { pose: Some(pose), camera, covariance, .. } = found[index] {
            posed.views.push(scene.photographs[index].view(pose, camera));
            posed.order.push(index);
            posed.covariances.push(covariance);
        }
    }
    Ok(Some(posed))
}

/// The robust factor from the reference's prior to its depths by matches; 1 without any.
fn unit_of(depths: &[(Point2<f64>, f64)], prior: Option<&Array2<f32>>) -> f64 {
    let Some(prior) = prior else { return 1.0 };
    let logs = depths.iter().filter_map(|(pixel, depth)| {
        let known = *prior.get((pixel.y.round() as usize, pixel.x.round() as usize)).filter(|z| **z > 0.0)?;
        (*depth > 0.0).then(|| (depth / f64::from(known)).ln())
    });
    median(logs).map_or(1.0, f64::exp)
}
