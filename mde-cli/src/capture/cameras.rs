//! Poses and cameras of the photographs, refined or estimated.

use super::report::{CaptureReport, PoseSource};
use super::{Capture, view};
use crate::Result;
use crate::config::Config;
use mde_mvs::poses::{
    self, PosesConfig, RefineConfig, Track, Verdict, estimate_poses_with, refine_poses_with,
};
use mde_uncertainty::random::derived_seed;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::Matrix6;
use ndarray::Array2;

/// The photographs with a pose, in the frame of the capture's reference.
#[derive(Debug)]
pub(super) struct Posed {
    /// That reference first.
    pub(super) views: Vec<PosedView>,
    /// Index of each view among the photographs.
    pub(super) order: Vec<usize>,
    /// Covariance of each view's pose, from the capture's reference; none where it was given and kept.
    pub(super) covariances: Vec<Option<Matrix6<f64>>>,
    /// Unit of the poses per unit of the prior: the prior's depth times this is in the unit of the poses.
    pub(super) unit: f64,
}

/// The posed views, or nothing (with the reason in the report) where no photograph but the reference has a pose with parallax. The
/// callback counts the pairs of photographs as they are matched.
pub(super) fn posed(
    capture: &Capture,
    priors: &[Option<Array2<f32>>],
    config: &Config,
    report: &mut CaptureReport,
    matched: &mut mde_mvs::Callback<'_>,
) -> Result<Option<Posed>> {
    let inputs: Vec<poses::Photograph<'_>> = capture
        .photographs
        .iter()
        .zip(priors)
        .map(|(photograph, prior)| poses::Photograph {
            name: &photograph.name,
            image: photograph.image.view(),
            camera: photograph.camera,
            focal_assumed: photograph.focal_assumed && photograph.pose.is_none(),
            prior: prior.as_ref().map(|depth| depth.view()),
        })
        .collect();
    let seed = derived_seed(config.seed, "poses", 0);
    let reference = capture.reference;
    let given: Option<Vec<Pose>> = capture.photographs.iter().map(|p| p.pose).collect();
    let (cameras, poses, covariances, unit) = match given {
        Some(given) => {
            let world = given[reference].inverse();
            let given: Vec<Pose> = given.iter().map(|pose| pose * world).collect();
            let refined =
                refine_poses_with(&inputs, &given, reference, &RefineConfig::default(), seed, matched)?;
            report.poses = if refined.accepted { PoseSource::Refined } else { PoseSource::Given };
            report.withheld_pixels = refined.withheld;
            let unit = unit(&refined.tracks, reference, priors[reference].as_ref());
            let cameras: Vec<PinholeCamera> = capture.photographs.iter().map(|p| p.camera).collect();
            let poses: Vec<Option<Pose>> = refined.poses.into_iter().map(Some).collect();
            (cameras, poses, refined.covariances, unit)
        }
        None => {
            let settings = PosesConfig::default();
            let matches = capture.matches.as_ref();
            let estimated = estimate_poses_with(&inputs, reference, matches, &settings, seed, matched)?;
            report.poses = PoseSource::Estimated;
            report.focal_factor = Some(estimated.focal_factor);
            for (photograph, found) in report.photographs.iter_mut().zip(&estimated.photographs) {
                photograph.verdict = found.verdict.to_string();
                photograph.matches = Some(found.tracks);
            }
            let parallax = estimated.photographs.iter().any(|p| p.verdict == Verdict::Posed);
            if !parallax {
                let reasons: Vec<String> = report
                    .photographs
                    .iter()
                    .enumerate()
                    .filter(|(index, _)| *index != reference)
                    .map(|(_, photograph)| format!("{}: {}", photograph.name, photograph.verdict))
                    .collect();
                report.fallback = Some(reasons.join("; "));
                return Ok(None);
            }
            let found = estimated.photographs;
            let covariances = found.iter().map(|p| p.covariance).collect();
            (
                found.iter().map(|p| p.camera).collect(),
                found.iter().map(|p| p.pose).collect(),
                covariances,
                1.0,
            )
        }
    };
    let mut order = vec![reference];
    order.extend((0..poses.len()).filter(|&index| index != reference && poses[index].is_some()));
    let views = order
        .iter()
        .map(|&index| {
            view(&capture.photographs[index], poses[index].unwrap_or_else(Pose::identity), cameras[index])
        })
        .collect::<Result<Vec<_>>>()?;
    let covariances = order.iter().map(|&index| covariances[index]).collect();
    Ok(Some(Posed { views, order, covariances, unit }))
}

/// The robust factor from the reference's prior to the depth of its tracks; 1 without tracks.
fn unit(tracks: &[Track], reference: usize, prior: Option<&Array2<f32>>) -> f64 {
    let Some(prior) = prior else { return 1.0 };
    let logs = tracks.iter().filter_map(|track| {
        let anchor = track.pixels.first().filter(|pixel| pixel.photograph == reference)?;
        let [row, column] = [anchor.pixel.y.round() as usize, anchor.pixel.x.round() as usize];
        let depth = *prior.get((row, column)).filter(|z| **z > 0.0)?;
        (track.depth > 0.0).then(|| (track.depth / f64::from(depth)).ln())
    });
    median(logs).map_or(1.0, f64::exp)
}
