use super::{check, known};
use crate::{Refined, Result, Task};
use mde_prior::{DepthKind, PriorDepth, augment};
use ndarray::s;

/// Mean of the prior and the model's depth of the mirror image, mirrored back: errors that depend on the side cancel.
pub fn flip_average(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let mirrored = task.predict(task.image.slice(s![.., ..;-1, ..]))?;
    crate::raster::same_shape("the model's depth of the mirror image", mirrored.dim(), task.prior.dim())?;
    let depths = |map| PriorDepth::from_values(map, DepthKind::Metric);
    let mut depth = augment::flip_average(depths(task.prior.to_owned())?, &depths(mirrored)?)?.map;
    depth.zip_mut_with(&task.prior, |d, prior| *d = if known(*prior) { *d } else { 0.0 });
    Ok(depth.into())
}
