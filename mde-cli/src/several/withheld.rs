//! A check on a photograph that the depth has not used.

use crate::error::Result;
use crate::reports::capture::{CaptureReport, WithheldPhotograph};
use crate::scene::Scene;
use mde_mvs::consensus::Reconstruction;
use mde_mvs::withheld::{typical, withheld_error};
use mde_warp::PosedView;
use ndarray::ArrayView2;

/// The error of one photograph through the depth of the others, at low resolution; nothing with fewer than three photographs.
pub(super) fn withheld(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    order: &[usize],
    known: &Reconstruction,
    scene: &Scene,
) -> Result<Option<WithheldPhotograph>> {
    let centre = |view: &PosedView| view.pose.inverse().translation.vector;
    let Some((reference, others)) = views.split_first() else { return Ok(None) };
    let distances: Vec<f64> = others.iter().map(|view| (centre(view) - centre(reference)).norm()).collect();
    let Some(index) = typical(&distances).map(|index| index + 1) else { return Ok(None) };
    let error = withheld_error(views, priors, index, known.scale)?;
    Ok(error.map(|error| WithheldPhotograph { name: scene.photographs[order[index]].name.clone(), error }))
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
