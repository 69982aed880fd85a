use super::{channels, check, known};
use crate::{Refined, Refiner, Result, Task};
use ndarray::{Array2, ArrayView3};
use rayon::prelude::*;

/// Joint bilateral filter (Petschnigg et al., 2004): the mean of depth weighted by nearness in place and in colour,
///
/// \\[ w(x, y) = \exp\left(-\frac{\\|x - y\\|^2}{2\sigma_s^2} - \frac{\\|I_x - I_y\\|^2}{2\sigma_r^2}\right), \\]
///
/// over a square of two \\(\sigma_s\\) to each side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointBilateral {
    /// \\(\sigma_s\\), pixels.
    pub sigma_space: f64,
    /// \\(\sigma_r\\), in colour (0 to 1).
    pub sigma_colour: f64,
}

impl Default for JointBilateral {
    fn default() -> Self {
        Self { sigma_space: 8.0, sigma_colour: 0.1 }
    }
}

impl Refiner for JointBilateral {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task, &[("sigma-space", self.sigma_space), ("sigma-colour", self.sigma_colour)])?;
        let radius = (2.0 * self.sigma_space).ceil() as usize;
        let guide = Guide::new(task.image, self.sigma_colour);
        let depth = task.prior.mapv(|d| if known(d) { d } else { 0.0 });
        let near = |offset: usize| (-0.5 * (offset as f64 / self.sigma_space).powi(2)).exp() as f32;
        let falloff: Vec<f32> = (0..=radius).map(near).collect();
        let filtered = by_pixel(depth.dim(), |y, x, weights: &mut Vec<f32>| {
            let here = depth[(y, x)];
            if here <= 0.0 {
                return 0.0;
            }
            let (mut sum, mut total) = (0.0_f64, 0.0_f64);
            for (row, columns) in guide.window(y, x, radius) {
                guide.weights((y, x), row, columns.clone(), weights);
                let line = depth.row(row);
                let Some(line) = line.as_slice().and_then(|line| line.get(columns.clone())) else { continue };
                let (mut row_sum, mut row_total) = (0.0, 0.0);
                for ((weight, &d), column) in weights.iter().zip(line).zip(columns) {
                    let weight = if d > 0.0 { weight * falloff[column.abs_diff(x)] } else { 0.0 };
                    row_sum += weight * d;
                    row_total += weight;
                }
                let along = f64::from(falloff[row.abs_diff(y)]);
                sum += along * f64::from(row_sum);
                total += along * f64::from(row_total);
            }
            if total > 0.0 { (sum / total) as f32 } else { here }
        });
        Ok(filtered.into())
    }
}

/// A map made pixel by pixel, rows in parallel; each row has a scratch list.
pub(super) fn by_pixel<S: Default>(
    (height, width): (usize, usize),
    of: impl Fn(usize, usize, &mut S) -> f32 + Sync,
) -> Array2<f32> {
    let mut out = Array2::zeros((height, width));
    if width > 0
        && let Some(values) = out.as_slice_mut()
    {
        values.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let mut scratch = S::default();
            row.iter_mut().enumerate().for_each(|(x, value)| *value = of(y, x, &mut scratch));
        });
    }
    out
}

/// Nearness in colour.
pub(super) struct Guide {
    planes: [Array2<f32>; 3],
    /// \\(1 / (2 \sigma_r^2)\\) over the number of factors of the exponential.
    scale: f32,
}

impl Guide {
    /// \\(e^{-u}\\) as \\((1 - u/n)^n\\), \\(n = 2^{10}\\), which has no branch: off by less than \\(u^2/n\\) of itself.
    const SQUARINGS: u32 = 10;

    pub(super) fn new(image: ArrayView3<'_, f32>, sigma: f64) -> Self {
        let scale = 0.5 / (sigma * sigma) / f64::from(1_u32 << Self::SQUARINGS);
        Self { planes: channels(image), scale: scale as f32 }
    }

    /// Rows and columns within `radius` of a pixel.
    pub(super) fn window(
        &self,
        y: usize,
        x: usize,
        radius: usize,
    ) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
        let (height, width) = self.planes[0].dim();
        let range = |at: usize, side: usize| {
            at.saturating_sub(radius)..at.saturating_add(radius).saturating_add(1).min(side)
        };
        let columns = range(x, width);
        range(y, height).map(move |row| (row, columns.clone()))
    }

    /// \\(\exp(-\\|I_x - I_y\\|^2 / 2\sigma_r^2)\\) of a pixel and some columns of a row.
    pub(super) fn weights(
        &self,
        at: (usize, usize),
        row: usize,
        columns: std::ops::Range<usize>,
        weights: &mut Vec<f32>,
    ) {
        weights.clear();
        weights.resize(columns.len(), 0.0);
        for plane in &self.planes {
            let here = plane[at];
            let line = plane.row(row);
            let Some(line) = line.as_slice().and_then(|line| line.get(columns.clone())) else { return };
            weights.iter_mut().zip(line).for_each(|(sum, &there)| *sum += (there - here) * (there - here));
        }
        for weight in weights.iter_mut() {
            let mut factor = (1.0 - *weight * self.scale).max(0.0);
            for _ in 0..Self::SQUARINGS {
                factor *= factor;
            }
            *weight = factor;
        }
    }
}
