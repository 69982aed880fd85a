//! Several photographs: poses, choice, sweeps and field.

use mde_fusion::FusionReport;
use mde_mvs::consensus::Reconstruction;
use mde_mvs::evidence::Evidence;
use mde_mvs::exposure::Exposure;
use mde_mvs::views::ViewScore;
use mde_mvs::withheld::WithheldError;
use mde_nerf::FitReport;
use mde_warp::{PinholeCamera, Pose, PosedView, matrix_rows};
use ndarray::Array3;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// Verdicts on the photographs that are used.
const REFERENCE: &str = "the reference";
const POSED: &str = "has a pose";

/// Report of a run with several photographs.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CaptureReport {
    /// One per photograph, in the capture's order.
    pub photographs: Vec<PhotographReport>,
    /// Origin of the poses.
    pub poses: PoseSource,
    /// Median distance of withheld matches from their prediction, with the given and with the refined poses, pixels of a photograph
    /// of 640 on the longer side.
    pub withheld_pixels: Option<[f64; 2]>,
    /// Colour error of a photograph through the depth of the others, at low resolution; none with fewer than three photographs.
    pub withheld_colours: Option<WithheldPhotograph>,
    /// Photographs whose given pose the matches contradict: they have that of the matches.
    pub moved: Vec<String>,
    /// Factor on assumed focal lengths.
    pub focal_factor: Option<f64>,
    /// Standard deviation of its logarithm.
    pub focal_sigma: Option<f64>,
    /// Radial distortion with which the matches fit better beyond chance, as the share of its distance from the centre by which a corner moves.
    pub distortion: Option<f64>,
    /// Unit of the poses per unit of the prior, and the standard deviation of its logarithm.
    pub scale: Option<[f64; 2]>,
    /// The field's fit.
    #[serde(skip)]
    pub fit: Option<FitReport>,
    /// Estimates of the fusion in the paper's order, where that was asked for.
    pub fusion: Option<FusionReport>,
    /// Share of the reference's pixels whose refined depth at least one other photograph confirms.
    pub confirmed: Option<f64>,
    /// Where the depth of each pixel comes from.
    #[serde(skip)]
    pub evidence: Option<Evidence>,
    /// A photograph beside what the field renders from its place: the best of those that [`MultiViewConfig::max_views`](crate::config::MultiViewConfig::max_views)
    /// leaves out, else the least needed of those in the fit.
    pub novel: Option<NovelView>,
    /// Reason for refining the reference alone; none where the photographs were used.
    pub fallback: Option<String>,
    /// Wall seconds by stage.
    pub seconds: CaptureSeconds,
}

/// A photograph that was compared with the depth of the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WithheldPhotograph {
    /// Its name.
    pub name: String,
    /// Its error through that depth and through the prior.
    #[serde(flatten)]
    pub error: WithheldError,
}

/// Report of one photograph.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PhotographReport {
    /// Its name.
    pub name: String,
    /// Whether its colours and depth were used.
    pub used: bool,
    /// Result of the pose estimation.
    pub verdict: String,
    /// Number of its features that fit its pose and were matched in other photographs; for given poses, of its matches that fit them.
    pub matches: Option<usize>,
    /// Distance from the reference over the median depth of what both see.
    pub parallax: Option<f64>,
    /// Share of the reference's pixels that project into it.
    pub overlap: Option<f64>,
    /// Mean squared gradient over that of the sharpest photograph.
    pub sharpness: Option<f64>,
    /// Rotation against the reference, degrees.
    pub rotation_degrees: Option<f64>,
    /// Gain and bias per channel to the reference's exposure.
    pub exposure: Option<Exposure>,
    /// Share of its pixels whose depth another photograph confirms.
    pub verified: Option<f32>,
    /// World to camera, row by row: the world is the reference's camera frame, in the unit of the refined depth. None where it was
    /// not used, and where known depths shifted the depth.
    #[serde(serialize_with = "rows")]
    pub pose: Option<Pose>,
    /// Its camera, with the focal length that was used.
    pub camera: Option<PinholeCamera>,
}

/// A photograph, what the field renders from its place, and how far they differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NovelView {
    /// Index among the capture's photographs.
    pub photograph: usize,
    /// Whether its colours and its depth took no part in sweeps and fit. Its matches took part in the pose estimation.
    pub withheld: bool,
    /// PSNR of the field's rendering, dB.
    pub psnr: Option<f64>,
    /// PSNR of the reference moved there by the gauged prior, over the same pixels, dB.
    pub psnr_of_prior: Option<f64>,
    /// Share of its pixels that are compared: those which the field renders and the moved reference reaches.
    pub compared: f64,
    /// The photograph in the reference's exposure, `[height, width, 3]`, at most 320 pixels a side.
    #[serde(skip)]
    pub image: Array3<f32>,
    /// The field's rendering, of the same size; grey where the field has nothing.
    #[serde(skip)]
    pub rendered: Array3<f32>,
}

/// Origin of the poses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSource {
    /// As given; the refinement did not explain withheld matches better.
    #[default]
    Given,
    /// Given, then refined on matches.
    Refined,
    /// Estimated from matches and the prior.
    Estimated,
}

/// Wall seconds by stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct CaptureSeconds {
    /// Predictions of the prior.
    pub prior: f64,
    /// Features, matches, poses.
    pub poses: f64,
    /// Sweeps, consensus, exposures.
    pub sweep: f64,
    /// The field's fit.
    pub fit: f64,
    /// Rendering the reference.
    pub render: f64,
}

impl CaptureReport {
    /// The warning of a [`distortion`](Self::distortion).
    pub(crate) fn lens_warning(&self) -> Option<String> {
        let percent = 100.0 * self.distortion?.abs();
        Some(format!(
            "the matches fit better with a lens that moves the corners by {percent:.0} % of their distance from the centre: the camera or the poses are wrong, and depth may be; \
             give undistorted photographs, or a capture with its camera model, such as COLMAP's"
        ))
    }

    pub(crate) fn new<'n>(names: impl Iterator<Item = &'n str>) -> Self {
        let of = |name: &str| PhotographReport { name: name.to_owned(), ..PhotographReport::default() };
        Self { photographs: names.map(of).collect(), ..Self::default() }
    }

    /// Number of photographs that were used, the reference included.
    pub fn used(&self) -> usize {
        self.photographs.iter().filter(|photograph| photograph.used).count()
    }

    /// The verdicts on all photographs but the reference; of those that differ in numbers alone, the first.
    pub(crate) fn verdicts(&self, reference: usize) -> String {
        let mut alike = BTreeMap::<String, Vec<&PhotographReport>>::new();
        for (_, one) in self.photographs.iter().enumerate().filter(|(index, _)| *index != reference) {
            alike.entry(one.verdict.replace(|c: char| c.is_ascii_digit(), "")).or_default().push(one);
        }
        let verdict = |group: &Vec<&PhotographReport>| {
            let more = if group.len() > 1 { format!(" and {} more", group.len() - 1) } else { String::new() };
            format!("{}{more}: {}", group[0].name, group[0].verdict)
        };
        alike.values().map(verdict).collect::<Vec<_>>().join("; ")
    }

    /// The report of predictions and poses with another photograph as the one that is refined.
    pub(crate) fn of(&self, reference: usize) -> Self {
        let mut report = self.clone();
        let same = self.photographs[reference].verdict == REFERENCE;
        for (index, photograph) in report.photographs.iter_mut().enumerate() {
            photograph.used = index == reference;
            if !same {
                (photograph.parallax, photograph.overlap, photograph.rotation_degrees) = (None, None, None);
            }
            photograph.verdict = photograph.verdict.replace(REFERENCE, POSED);
        }
        REFERENCE.clone_into(&mut report.photographs[reference].verdict);
        report
    }

    pub(crate) fn take(&mut self, reconstruction: &Reconstruction, order: &[usize]) {
        for (known, &index) in reconstruction.views.iter().zip(order) {
            self.photographs[index].verified = Some(known.verified);
        }
    }

    /// Cameras and poses of the photographs that were used, of `factor` units of the poses per unit of the depth.
    pub(crate) fn place(&mut self, views: &[PosedView], order: &[usize], factor: f64) {
        for (view, &index) in views.iter().zip(order) {
            let mut pose = view.pose;
            pose.translation.vector /= factor;
            self.photographs[index].pose = Some(pose);
            self.photographs[index].camera = Some(view.camera);
        }
    }
}

fn rows<S: Serializer>(pose: &Option<Pose>, serializer: S) -> Result<S::Ok, S::Error> {
    pose.as_ref().map(matrix_rows).serialize(serializer)
}

impl PhotographReport {
    /// Whether it was left out for want of a pose that its matches fit; [`verdict`](Self::verdict) has the reason.
    pub fn has_no_pose(&self) -> bool {
        !self.used && self.verdict != REFERENCE && self.verdict != POSED
    }

    pub(crate) fn take(&mut self, score: &ViewScore, used: bool, view: &PosedView, reference: &PosedView) {
        self.used = used;
        self.parallax = Some(score.parallax);
        self.overlap = Some(score.overlap);
        self.sharpness = Some(score.sharpness);
        self.rotation_degrees = Some((view.pose * reference.pose.inverse()).rotation.angle().to_degrees());
    }
}
