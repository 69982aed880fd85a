use super::{check, known};
use crate::raster::{blur_known, four_sigma, mean_of, same_shape};
use crate::{Method, Refined, Result, Task};
use mde_prior::{DepthKind, PriorDepth, augment};
use ndarray::{Array2, ArrayView2, Zip, s};

/// Mean of the prior and the model's depth of the mirror image, mirrored back: errors that depend on the side cancel.
pub fn flip_average(task: &Task<'_>) -> Result<Refined> {
    check(task)?;
    let mirrored = task.predict(task.image.slice(s![.., ..;-1, ..]))?;
    same_shape("the model's depth of the mirror image", mirrored.dim(), task.prior.dim())?;
    let depths = |map| PriorDepth::from_values(map, DepthKind::Metric);
    let mut depth = augment::flip_average(depths(task.prior.to_owned())?, &depths(mirrored)?)?.map;
    depth.zip_mut_with(&task.prior, |d, prior| *d = if known(*prior) { *d } else { 0.0 });
    Ok(depth.into())
}

/// Runs the model on zoomed crops and merges their detail, after the double estimation of Miangoleh et al. (CVPR 2021), by filters alone.
///
/// For each grid of \\(n \times n\\) crops that overlap by half, one grid after the other: the log depth of a crop is brought to
/// the current map's by least squares (scale and shift), its low frequencies (a Gaussian of a sixth of the crop's width) are
/// replaced by the current map's, and the change is blended with a Hann window. Low frequencies thus stay the prior's.
pub struct ZoomMerge {
    /// \\(n\\) of each grid, in order.
    grids: Vec<usize>,
}

impl ZoomMerge {
    /// The grids 2, 3, ... that have at most `predictions` in all, the whole image included.
    #[must_use]
    pub fn with_predictions(predictions: usize) -> Self {
        let mut left = predictions.saturating_sub(1);
        let fits = |n: &usize| {
            n.checked_mul(*n).and_then(|crops| left.checked_sub(crops)).map(|rest| left = rest).is_some()
        };
        Self { grids: (2..).take_while(fits).collect() }
    }
}

impl Method for ZoomMerge {
    fn refine(&self, task: &Task<'_>) -> Result<Refined> {
        check(task)?;
        // Missing depth takes part as the median, and is missing again in the end.
        let all: Vec<f64> = task.prior.iter().filter(|d| known(**d)).map(|d| f64::from(*d)).collect();
        let Some(middle) = mde_uncertainty::statistics::median(all) else {
            return Ok(task.prior.mapv(|_| 0.0).into());
        };
        let mut logs = task.prior.mapv(|d| if known(d) { f64::from(d).ln() } else { middle.ln() });
        for &n in &self.grids {
            let change = grid(task, &logs, n)?;
            logs += &change;
        }
        let refined = Zip::from(task.prior).and(&logs).map_collect(|&d, log| {
            let value = log.exp() as f32;
            if known(d) && known(value) { value } else { 0.0 }
        });
        Ok(refined.into())
    }
}

/// What `n` x `n` crops change in the log depth.
fn grid(task: &Task<'_>, logs: &Array2<f64>, n: usize) -> Result<Array2<f64>> {
    let (height, width) = logs.dim();
    // Overlapping by half, n crops of side 2 / (n + 1) cover the image.
    let [tall, wide] = [height, width].map(|side| (2 * side).div_ceil(n + 1).min(side));
    let start = |k: usize, side: usize, crop: usize| k * (side - crop) / (n - 1);
    let (mut change, mut weight) = (Array2::zeros(logs.dim()), Array2::<f64>::zeros(logs.dim()));
    for row in 0..n {
        for column in 0..n {
            let (y, x) = (start(row, height, tall), start(column, width, wide));
            let window = s![y..y + tall, x..x + wide];
            let crop = task.predict(task.image.slice(s![y..y + tall, x..x + wide, ..]))?;
            same_shape("the model's depth of a crop", crop.dim(), (tall, wide))?;
            let Some(detail) = detail(crop.view(), logs.slice(window)) else { continue };
            let hann = |at: usize, side: usize| {
                (std::f64::consts::PI * (at as f64 + 0.5) / side as f64).sin().powi(2)
            };
            Zip::indexed(&detail).and(change.slice_mut(window)).and(weight.slice_mut(window)).for_each(
                |(v, u), detail, change, weight| {
                    let blend = hann(v, tall) * hann(u, wide);
                    *change += blend * detail;
                    *weight += blend;
                },
            );
        }
    }
    Ok(mean_of(change, &weight))
}

/// What the crop's detail changes in the current log depth; nothing where it cannot be brought to it.
fn detail(crop: ArrayView2<'_, f32>, current: ArrayView2<'_, f64>) -> Option<Array2<f64>> {
    let pairs =
        || crop.iter().zip(current).filter(|(d, _)| known(**d)).map(|(d, c)| (f64::from(*d).ln(), *c));
    let n = pairs().count() as f64;
    let (mx, my) = pairs().fold((0.0, 0.0), |(x, y), pair| (x + pair.0 / n, y + pair.1 / n));
    let (xx, xy) =
        pairs().fold((0.0, 0.0), |(xx, xy), (x, y)| (xx + (x - mx).powi(2), xy + (x - mx) * (y - my)));
    // A crop that is anticorrelated with the map carries no detail of it.
    if !(n > 1.0 && xx > 1e-12 && xy > 0.0) {
        return None;
    }
    let aligned = Zip::from(crop)
        .and(current)
        .map_collect(|&d, &c| if known(d) { my + xy / xx * (f64::from(d).ln() - mx) } else { c });
    let sigma = (crop.ncols() as f64 / 6.0).max(1.0);
    // Only the difference's high frequencies change anything.
    let difference = aligned - current;
    let low = blur_known(&difference, &Array2::ones(crop.dim()), four_sigma(sigma));
    Some(difference - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_fit_into_the_number_of_predictions() {
        let grids = |predictions| ZoomMerge::with_predictions(predictions).grids;
        assert_eq!([0, 4, 5, 13].map(grids), [vec![], vec![], vec![2], vec![2]]);
        assert_eq!([14, 30, 60].map(grids), [vec![2, 3], vec![2, 3, 4], vec![2, 3, 4, 5]]);
    }
}
