use super::{channels, check, known};
use crate::{Refined, Result, Task};
use ndarray::{Array2, s};
use rayon::prelude::*;

/// Half the window's side without its middle, pixels.
const RADIUS: usize = 15;
/// \\(\sigma_r\\), in colour (0 to 1).
const SIGMA_COLOUR: f64 = 0.1;
const BINS: usize = 256;

/// Weighted median filter (Ma et al., ICCV 2013): the depth at which half the weight of a square is nearer, weights by nearness in colour,
/// \\(\exp(-\\|I_x - I_y\\|^2 / 2\sigma_r^2)\\).
///
/// The median is found among 256 bins of log depth between the nearest and farthest; the result is the weighted mean of
/// the depths in its bin, so it is off by less than a bin and a constant depth is kept exactly.
pub fn weighted_median(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let planes = channels(task.image);
    let depth = task.prior.mapv(|d| if known(d) { d } else { 0.0 });
    let (height, width) = depth.dim();
    let logs = || depth.iter().filter(|d| **d > 0.0).map(|d| d.ln());
    let (low, high) = logs().fold((f32::MAX, f32::MIN), |(low, high), l| (low.min(l), high.max(l)));
    let gain = if high > low { BINS as f32 / (high - low) } else { 0.0 };
    let bin =
        depth.mapv(|d| if d > 0.0 { (((d.ln() - low) * gain) as usize).min(BINS - 1) as u8 } else { 0 });
    let within = |at: usize, side: usize| at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(side);
    // Bins hold weight and weighted depth.
    let filter = |y: usize, x: usize, weights: &mut Vec<f32>, bins: &mut [[f32; 2]]| {
        let here = depth[(y, x)];
        if here <= 0.0 {
            return 0.0;
        }
        bins.fill([0.0; 2]);
        let columns = within(x, width);
        for row in within(y, height) {
            let part = s![row, columns.clone()];
            weights.clear();
            weights.resize(columns.len(), 0.0);
            for plane in &planes {
                let colour = plane[(y, x)];
                let others = weights.iter_mut().zip(plane.slice(part).to_slice().unwrap_or_default());
                others.for_each(|(sum, other)| *sum += (other - colour) * (other - colour));
            }
            weights.iter_mut().for_each(|weight| *weight = exponential(*weight));
            let depths = depth.slice(part).to_slice().unwrap_or_default();
            let places = bin.slice(part).to_slice().unwrap_or_default();
            for ((&weight, &d), &place) in weights.iter().zip(depths).zip(places) {
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
        values.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            let (mut weights, mut bins) = (Vec::new(), vec![[0.0; 2]; BINS]);
            let pixels = row.iter_mut().enumerate();
            pixels.for_each(|(x, value)| *value = filter(y, x, &mut weights, &mut bins));
        });
    }
    Ok(filtered.into())
}

/// \\(e^{-d / 2\sigma_r^2}\\) of a squared difference of colours, as \\((1 - u/n)^n\\), \\(n = 2^{10}\\), which has no branch: off by less
/// than \\(u^2/n\\) of itself.
fn exponential(squared: f32) -> f32 {
    const SQUARINGS: u32 = 10;
    let scale = 0.5 / (SIGMA_COLOUR * SIGMA_COLOUR) / f64::from(1_u32 << SQUARINGS);
    let factor = (1.0 - squared * scale as f32).max(0.0);
    (0..SQUARINGS).fold(factor, |factor, _| factor * factor)
}
