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
mod cloud;
mod evidence;
mod guard;
mod novel;
mod prepared;
mod priors;
mod report;
mod result;

pub use cloud::{ConsistentPoint, RefinedView, consistent_points};
pub use evidence::{Evidence, Origin};
pub use novel::NovelView;
pub use prepared::PreparedCapture;
pub use report::{CaptureReport, CaptureSeconds, PhotographReport, PoseSource, WithheldPhotograph};

use crate::config::Config;
use crate::refinement::event::Callback;
use crate::reports::Refinement;
use crate::refinement::stages::Stages;
use crate::error::{Error, Result};
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::Point3;
use ndarray::{Array2, Array3};

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
    /// Points that the reference shows, such as COLMAP's, in the world of the poses. 16 or more give the scale between poses and prior,
    /// which the sweeps find otherwise. Not used without poses.
    pub points: Vec<Point3<f64>>,
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

/// Refines the depth of the reference photograph with the parallax of the others; [`PreparedCapture`] refines several of them.
///
/// Depth and sigma are `[height, width]` of the reference, z in the prior's unit. Where the photographs carry no depth (no
/// common scene, no parallax, hardly anything verified, or a withheld photograph that the prior explains better), the result is that
/// of [`refine`](crate::refinement::refine) with [`Preset::Default`](crate::config::Preset::Default) for the reference alone, and
/// [`CaptureReport::fallback`] has the reason.
///
/// # Errors
/// The error of a stage, [`Error::Capture`] for a capture that [`Capture::validate`] refuses, and those of
/// [`refine`](crate::refinement::refine).
pub fn refine_capture(
    capture: &Capture,
    stages: Stages<'_>,
    config: &Config,
    callback: &mut Callback<'_>,
) -> Result<Refinement> {
    PreparedCapture::new(capture, &stages, config, callback)?.refine(capture.reference, stages, callback)
}
