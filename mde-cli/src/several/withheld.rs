//! A check on a photograph that the depth has not used.

use crate::error::Result;
use crate::reports::capture::{CaptureReport, WithheldPhotograph};
use crate::scene::Scene;
use crate::several::novel::Candidate;
use mde_mvs::consensus::Reconstruction;
use mde_mvs::withheld::{typical, unused_error, withheld_error};
use mde_warp::PosedView;
use ndarray::Array2;

/// The error of a photograph that is left over, through the depth of those that were used; without one, of one of those through the depth of
/// the others, at low resolution. Nothing with fewer than three photographs.
pub(super) fn withheld(
    views: &[PosedView],
    priors: Vec<Array2<f32>>,
    order: &[usize],
    known: &Reconstruction,
    unused: Option<&Candidate>,
    scene: &Scene,
) -> Result<Option<WithheldPhotograph>> {
    let (Some((reference, others)), Some(own)) = (views.split_first(), known.views.first()) else {
        return Ok(None);
    };
    let priors: Vec<_> = priors.iter().map(|prior| prior.view()).collect();
    let (index, error) = if let Some(unused) = unused {
        (unused.index, unused_error(reference, &unused.view, own, priors[0], known.scale)?)
    } else {
        let centre = |view: &PosedView| view.pose.inverse().translation.vector;
        let distances: Vec<f64> =
            others.iter().map(|view| (centre(view) - centre(reference)).norm()).collect();
        let Some(index) = typical(&distances).map(|index| index + 1) else { return Ok(None) };
        (order[index], withheld_error(views, &priors, index, known.scale)?)
    };
    Ok(error.map(|error| WithheldPhotograph { name: scene.photographs[index].name.clone(), error }))
}

/// The reason for not using the photographs, where the withheld one fits the prior better.
pub(super) fn contradiction(report: &CaptureReport) -> Option<String> {
    let WithheldPhotograph { name, error } =
        report.withheld_colours.as_ref().filter(|w| w.error.is_worse())?;
    Some(format!(
        "the depth from the other photographs explains {name} worse (colour error {:.3}) than the monocular depth does ({:.3}); check that the \
         scene is static and that the poses belong to the photographs",
        error.found, error.prior
    ))
}
