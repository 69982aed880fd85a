use super::{check, known};
use crate::{Refined, Refiner, Result, Task};
use ndarray::{Zip, s};

/// Mean of the prior and the model's depth of the mirror image, mirrored back: errors that depend on the side cancel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FlipAverage;

impl Refiner for FlipAverage {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task, &[])?;
        let mirrored = task.predict(task.image.slice(s![.., ..;-1, ..]))?;
        crate::raster::same_shape("the model's depth of the mirror image", mirrored.dim(), task.prior.dim())?;
        let mut depth = task.prior.to_owned();
        Zip::from(&mut depth).and(mirrored.slice(s![.., ..;-1])).for_each(|d, &other| {
            *d = match (known(*d), known(other)) {
                (true, true) => 0.5 * (*d + other),
                (true, false) => *d,
                (false, _) => 0.0,
            };
        });
        Ok(depth.into())
    }
}
