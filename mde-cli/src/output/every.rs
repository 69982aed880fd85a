//! Every photograph of a capture refined: what is known of each, and the files of all together.

use crate::error::Result;
use crate::output::export::{Format, Placed, colmap, transforms};
use crate::output::record::About;
use crate::refiner::Refined;
use crate::reports::capture::CaptureReport;
use crate::several::prepared::PreparedScene;
use mde_mvs::cloud::{DepthView, consistent_points};
use mde_mvs::export::{glb, ply};
use mde_mvs::surface::surface;
use mde_uncertainty::statistics::{median, quantile};
use mde_warp::{PinholeCamera, Pose};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The frame of the points and the surface.
const FRAME: &str = "world of transforms.json";
/// The surface of all photographs.
pub const MESHES: [&str; 2] = ["mesh.ply", "mesh.glb"];
/// The points that two photographs confirm.
pub const CLOUD: &str = "cloud.ply";

/// One of many photographs, in the tables and records of all. Its [`Default`] is one that is not refined yet.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PhotographRow {
    /// Its name.
    pub photograph: String,
    /// Its folder; none where it failed.
    pub folder: Option<String>,
    /// Why it failed.
    pub error: Option<String>,
    /// Why the others did not refine it, which is in a folder all the same.
    pub reason: Option<String>,
    /// Width of the results, pixels.
    pub width: usize,
    /// Height of the results, pixels.
    pub height: usize,
    /// Horizontal focal length, pixels.
    pub fx: Option<f64>,
    /// Where the camera comes from.
    pub camera: String,
    /// Of its refinement.
    pub seconds: f64,
    /// Unit of the depth.
    pub unit: String,
    /// Factor of `--same-scale`.
    pub same_scale: Option<f64>,
    /// Standard deviation of its logarithm.
    pub same_scale_sigma: Option<f64>,
    /// Photographs that share a scale have the same number.
    pub same_scale_group: Option<usize>,
    /// Median of the depth, in its unit.
    pub median_depth: Option<f64>,
    /// Median of sigma over depth.
    pub sigma: Option<f64>,
    /// 90 % quantile of sigma over depth.
    pub sigma_90: Option<f64>,
    /// Pixels without depth.
    pub missing: usize,
    /// Share of its pixels whose depth another photograph confirms in the sweeps.
    pub verified: Option<f32>,
    /// Unit of the poses per unit of the results; none where it was refined alone.
    pub scale: Option<f64>,
    /// Its warnings.
    pub warnings: Vec<String>,
    /// Whether an earlier run finished it.
    #[serde(skip)]
    pub kept: bool,
}

impl PhotographRow {
    /// Of a photograph that is not refined yet.
    pub fn new(photograph: &str) -> Self {
        Self { photograph: photograph.to_owned(), ..Self::default() }
    }

    /// Of a photograph that failed.
    pub fn failed(photograph: &str, error: &str) -> Self {
        Self { error: Some(error.to_owned()), ..Self::new(photograph) }
    }

    /// Takes what its result has.
    pub fn measure(&mut self, result: &Refined<'_>) {
        let index = result.photograph;
        let report = result.refinement.capture.as_ref();
        self.reason = report.and_then(|report| report.fallback.clone());
        self.verified = report.and_then(|report| report.photographs.get(index)?.verified);
        self.scale = report
            .filter(|report| report.fallback.is_none())
            .and_then(|report| report.scale)
            .map(|[scale, _]| if result.unit == "capture" { 1.0 } else { scale });
        let camera = &result.camera;
        (self.width, self.height) = (camera.camera.width, camera.camera.height);
        self.fx = Some(camera.camera.fx);
        let source = serde_json::json!(camera.source); // A word, or a word with a value.
        let name = source.as_str().or_else(|| source.as_object()?.keys().next().map(String::as_str));
        self.camera = name.unwrap_or_default().to_owned();
        self.unit = result.unit.to_owned();
        self.same_scale = result.same_scale.map(|found| found.factor);
        self.same_scale_sigma = result.same_scale.map(|found| found.log_sigma);
        let (mean, sigma) = (result.refinement.depth.mean(), result.refinement.depth.sigma());
        self.median_depth = median(mean.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)));
        let known = mean.iter().zip(&sigma).filter(|(z, s)| **z > 0.0 && s.is_finite());
        let mut relative: Vec<f32> = known.map(|(z, s)| s / z).collect();
        self.sigma = median(relative.iter().copied().map(f64::from));
        self.sigma_90 = quantile(&mut relative, 0.9);
        self.missing = sigma.iter().filter(|s| s.is_infinite()).count();
    }

    /// `failed` or `done`.
    pub fn status(&self) -> &'static str {
        if self.error.is_some() { "failed" } else { "done" }
    }

    /// Camera of a refined photograph, and its pose for depths in the results' unit: world to camera. The world is that of a capture with
    /// poses in its own unit, else the frame of the capture's reference. None where it was refined alone.
    pub fn placed(&self, prepared: &PreparedScene<'_>, index: usize) -> Option<(PinholeCamera, Pose)> {
        let scale = self.scale?;
        let mut pose = prepared.pose(index)?;
        pose.translation.vector /= scale;
        let scene = prepared.scene();
        let pose = match scene.photographs.get(prepared.reference()).and_then(|reference| reference.pose) {
            Some(world) if scale.to_bits() == 1.0_f64.to_bits() => pose * world,
            _ => pose,
        };
        Some((prepared.camera(index)?, pose))
    }

    /// What became of a photograph that failed or that the others did not refine, of which its own record has the reason.
    pub fn failed_or_alone(&self) -> Option<String> {
        let alone = || self.reason.as_ref().map(|_| "refined alone".to_owned());
        self.error.as_ref().map(|error| format!("failed: {error}")).or_else(alone)
    }

    /// Name and error of a photograph that failed.
    pub fn failure(&self) -> Option<String> {
        Some(format!("{}: {}", self.photograph, self.error.as_deref()?))
    }
}

/// Writes `transforms.json` of all, `cloud.ply` of the points that two photographs confirm, and the formats of `export` that are of a whole
/// capture; the number of points. The `maps` of the cloud and the formats may be smaller than those in the folders.
///
/// # Errors
/// [`Error::Prior`](crate::error::Error::Prior) or [`Error::External`](crate::error::Error::External) for a file that can't be written.
pub fn write_all(
    folder: &Path,
    (placed, maps): (&[Placed<'_>], &[DepthView<'_>]),
    unit: &str,
    export: &[Format],
) -> Result<usize> {
    transforms::write(&folder.join(transforms::FILE), placed)?;
    let points = consistent_points(maps);
    if export.contains(&Format::ColmapDense) {
        colmap::write_dense(folder, (placed, maps), &points)?;
    }
    if export.contains(&Format::Mesh) {
        let surface = surface(maps)?;
        mde_prior::write_atomic(&folder.join(MESHES[0]), &ply::encode_surface(&surface, FRAME, unit))?;
        mde_prior::write_atomic(&folder.join(MESHES[1]), &glb::encode_surface(&surface, unit))?;
    }
    let frame = match points.len() {
        0 => "no point is confirmed by two photographs",
        _ => FRAME,
    };
    mde_prior::write_atomic(&folder.join(CLOUD), &ply::encode_points(&points, maps, frame, unit))?;
    Ok(points.len())
}

/// The record of a run that refined every photograph: its `run.json`.
#[derive(Debug, Serialize)]
pub struct EveryRecord<'r> {
    /// The common part.
    #[serde(flatten)]
    pub about: About<'r>,
    /// Unit of the results.
    pub unit: &'static str,
    /// The photographs.
    pub photographs: &'r [PhotographRow],
    /// Predictions and poses.
    pub poses: &'r CaptureReport,
    /// Points of the cloud.
    pub points: usize,
    /// Of the prior's predictions.
    pub prior_seconds: f64,
}
