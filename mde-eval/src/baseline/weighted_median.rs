use super::{channels, check, known};
use crate::{Method, Refined, Result, Task};
use ndarray::{Array2, ArrayView3};
use rayon::prelude::*;

/// Weighted median filter (Ma et al., ICCV 2013): the depth at which half the weight of a square is nearer, weights by nearness in colour,
/// \\(\exp(-\\|I_x - I_y\\|^2 / 2\sigma_r^2)\\).
///
/// The median is found among 256 bins of log depth between the nearest and farthest; the result is the weighted mean of
/// the depths in its bin, so it is off by less than a bin and a constant depth is kept exactly.
#[derive(Debug, Clone, Copy)]
pub struct WeightedMedian;

/// Half the window's side without its middle, pixels.
const RADIUS: usize = 15;
/// \\(\sigma_r\\), in colour (0 to 1).
const SIGMA_COLOUR: f64 = 0.1;
const BINS: usize = 256;

impl Method for WeightedMedian {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task)?;
        let guide = Guide::new(task.image);
        let depth = task.prior.mapv(|d| if known(d) { d } else { 0.0 });
        let logs = || depth.iter().filter(|d| **d > 0.0).map(|d| d.ln());
        let (low, high) = logs().fold((f32::MAX, f32::MIN), |(low, high), l| (low.min(l), high.max(l)));
        let gain = if high > low { BINS as f32 / (high - low) } else { 0.0 };
        let bin =
            depth.mapv(|d| if d > 0.0 { (((d.ln() - low) * gain) as usize).min(BINS - 1) as u8 } else { 0 });
        // Bins hold weight and weighted depth.
        let filter = |y: usize, x: usize, weights: &mut Vec<f32>, bins: &mut [[f32; 2]]| {
            let here = depth[(y, x)];
            if here <= 0.0 {
                return 0.0;
            }
            bins.fill([0.0; 2]);
            for (row, columns) in guide.window(y, x) {
                guide.weights((y, x), row, columns.clone(), weights);
                let (line, places) = (depth.row(row), bin.row(row));
                let (Some(line), Some(places)) = (line.as_slice(), places.as_slice()) else { continue };
                let Some((line, places)) = line.get(columns.clone()).zip(places.get(columns)) else {
                    continue;
                };
                for ((&weight, &d), &place) in weights.iter().zip(line).zip(places) {
                    if d > 0.0 {
                        let sums = &mut bins[usize::from(place)];
                        sums[0] += weight;
                        sums[1] += weight * d;
                    }
                }
            }
            let half = 0.5 * bins.iter().map(|b| f64::from(b[0])).sum::<f64>();
            let mut below = 0.0;
            let middle = bins.iter().find(|b| {
                below += f64::from(b[0]);
                b[0] > 0.0 && below >= half
            });
            middle.map_or(here, |[weight, sum]| sum / weight)
        };
        let mut filtered = Array2::zeros(depth.dim());
        if let Some(values) = filtered.as_slice_mut() {
            values.par_chunks_mut(depth.ncols().max(1)).enumerate().for_each(|(y, row)| {
                let (mut weights, mut bins) = (Vec::new(), vec![[0.0; 2]; BINS]);
                let pixels = row.iter_mut().enumerate();
                pixels.for_each(|(x, value)| *value = filter(y, x, &mut weights, &mut bins));
            });
        }
        Ok(filtered.into())
    }
}

/// Nearness in colour.
struct Guide {
    planes: [Array2<f32>; 3],
    /// \\(1 / (2 \sigma_r^2)\\) over the number of factors of the exponential.
    scale: f32,
}

impl Guide {
    /// \\(e^{-u}\\) as \\((1 - u/n)^n\\), \\(n = 2^{10}\\), which has no branch: off by less than \\(u^2/n\\) of itself.
    const SQUARINGS: u32 = 10;

    fn new(image: ArrayView3<'_, f32>) -> Self {
        let scale = 0.5 / (SIGMA_COLOUR * SIGMA_COLOUR) / f64::from(1_u32 << Self::SQUARINGS);
        Self { planes: channels(image), scale: scale as f32 }
    }

    /// Rows and columns within [`RADIUS`] of a pixel.
    fn window(&self, y: usize, x: usize) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
        let (height, width) = self.planes[0].dim();
        let range = |at: usize, side: usize| at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(side);
        let columns = range(x, width);
        range(y, height).map(move |row| (row, columns.clone()))
    }

    /// \\(\exp(-\\|I_x - I_y\\|^2 / 2\sigma_r^2)\\) of a pixel and some columns of a row.
    fn weights(
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
