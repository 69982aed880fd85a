//! The synthetic views (III.A) and the novel views and their reprojection (III.D).

use crate::config::Config;
use crate::error::{Error, Result};
use crate::refinement::event::{Callback, of_field};
use mde_nerf::RadianceField;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::random::derived_seed;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, WarpReport, reproject, sample_poses};
use ndarray::ArrayView3;

/// The training views of an iteration (Section III.A, Eq. 1), by [`mde_warp::synthesise`].
///
/// # Errors
/// The error of the warp, or [`Error::EmptyPrior`].
pub fn synthesise(
    image: ArrayView3<'_, f32>,
    camera: &PinholeCamera,
    depth: &GaussianDepth,
    config: &Config,
    iteration: usize,
) -> Result<(Vec<PosedView>, WarpReport)> {
    let seed = derived_seed(config.seed, "training-poses", iteration as u64);
    let rules = (&config.views, &config.warp);
    Ok(mde_warp::synthesise(image, depth, camera, rules, median_depth(depth)?, seed)?)
}

/// The depth that `field` renders from the novel poses, reprojected to the original camera (Eq. 6). `scale` is the median
/// depth; `callback` gets the field's events with the number of the view and of all views.
pub(super) fn render(
    field: &dyn RadianceField,
    camera: &PinholeCamera,
    scale: f64,
    config: &Config,
    iteration: usize,
    callback: &mut Callback<'_>,
) -> Result<Vec<GaussianDepth>> {
    let seed = derived_seed(config.seed, "novel-poses", iteration as u64);
    let mut poses = sample_poses(&config.novel_views(), scale, seed)?;
    if config.novel.count == 0 {
        poses.insert(0, Pose::identity());
    }
    let rules = ReprojectConfig { tear: config.warp.tear, ..ReprojectConfig::default() };
    let mut seen = Vec::with_capacity(poses.len());
    for (view, pose) in poses.iter().enumerate() {
        let mut listen = of_field(callback, view, poses.len());
        let rendered = field.render(camera, pose, &mut listen)?;
        seen.push(reproject(&rendered.depth, camera, pose, camera, &Pose::identity(), &rules)?);
    }
    Ok(seen)
}

pub(super) fn median_depth(depth: &GaussianDepth) -> Result<f64> {
    let middle = median(depth.mean().iter().copied().filter(|&d| d > 0.0)).ok_or(Error::EmptyPrior)?;
    // To the precision of the map.
    Ok(f64::from(middle as f32))
}
