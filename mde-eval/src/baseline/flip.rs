use super::{check, known};
use crate::{Method, Refined, Result, Task};
use mde_prior::augment::flip_average;
use mde_prior::{DepthKind, PriorDepth};
use ndarray::s;

/// Mean of the prior and the model's depth of the mirror image, mirrored back: errors that depend on the side cancel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FlipAverage;

impl Method for FlipAverage {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task)?;
        let mirrored = task.predict(task.image.slice(s![.., ..;-1, ..]))?;
        crate::raster::same_shape("the model's depth of the mirror image", mirrored.dim(), task.prior.dim())?;
        let depths = |map| PriorDepth::from_values(map, DepthKind::Metric);
        let mut depth = flip_average(depths(task.prior.to_owned())?, &depths(mirrored)?)?.map;
        depth.zip_mut_with(&task.prior, |d, prior| *d = if known(*prior) { *d } else { 0.0 });
        Ok(depth.into())
    }
}
