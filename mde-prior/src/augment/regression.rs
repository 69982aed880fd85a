use super::post_filter::blurred;
use crate::resample::{Filter, resize};
use ndarray::{Array2, ArrayView2, Zip};

/// Cells along each axis for the statistics of a crop: windows are much wider than a cell.
const CELLS: usize = 28;
/// \\(\varepsilon\\), added to every variance: a standard deviation of 0.01 counts as noise.
const EPSILON: f32 = 1e-4;
/// \\(a_{max}\\): steeper slopes amplify noise.
const STEEPEST: f32 = 3.0;

/// The change of the map by the prediction of a crop, \\(a L + b - c\\), all `[height, width]`; see the equations in
/// [`augment`](super).
pub(super) fn change(
    prediction: ArrayView2<'_, f32>,
    map: ArrayView2<'_, f32>,
    window: f64,
    exponent: f64,
) -> Array2<f32> {
    let (height, width) = prediction.dim();
    let cells = (CELLS.min(height), CELLS.min(width));
    let smooth = |map: Array2<f32>| {
        let [down, along] = [cells.0, cells.1].map(|side| window * side as f64);
        blurred(map.view(), down, along)
    };
    let mean = |of: &dyn Fn(f32, f32) -> f32| smooth(block_means(prediction, map, cells, of));
    let (l, c) = (mean(&|l, _| l), mean(&|_, c| c));
    let (ll, cc, lc) = (mean(&|l, _| l * l), mean(&|_, c| c * c), mean(&|l, c| l * c));
    let mut slope = Array2::zeros(cells);
    Zip::indexed(&mut slope).for_each(|at, slope| {
        let variance_l = (ll[at] - l[at] * l[at]).max(0.0) + EPSILON;
        let variance_c = (cc[at] - c[at] * c[at]).max(0.0) + EPSILON;
        let covariance = (lc[at] - l[at] * c[at]).max(0.0);
        let correlation = (covariance / (variance_l * variance_c).sqrt()).min(1.0);
        // Not 0^0 = 1: a crop without positive correlation adds nothing, whatever the exponent.
        let factor = if correlation > 0.0 { correlation.powf(exponent as f32) } else { 0.0 };
        *slope = ((variance_c / variance_l).sqrt() * factor).min(STEEPEST);
    });
    let offset = Zip::from(&c).and(&slope).and(&l).map_collect(|&c, &a, &l| c - a * l);
    let per_pixel = |field: Array2<f32>| {
        let smooth = smooth(field);
        resize(smooth.view(), (height, width), Filter::Bilinear)
    };
    let (slope, offset) = (per_pixel(slope), per_pixel(offset));
    Zip::from(&slope).and(&offset).and(prediction).and(map).map_collect(|&a, &b, &l, &c| a * l + b - c)
}

/// Means of a quantity over a grid of cells.
fn block_means(
    prediction: ArrayView2<'_, f32>,
    map: ArrayView2<'_, f32>,
    cells: (usize, usize),
    of: &dyn Fn(f32, f32) -> f32,
) -> Array2<f32> {
    let (height, width) = prediction.dim();
    let mut sums = Array2::<f64>::zeros(cells);
    let mut counts = Array2::<f64>::zeros(cells);
    for (y, (predictions, values)) in prediction.outer_iter().zip(map.outer_iter()).enumerate() {
        let row = y * cells.0 / height;
        for (x, (&l, &c)) in predictions.iter().zip(&values).enumerate() {
            let cell = (row, x * cells.1 / width);
            sums[cell] += f64::from(of(l, c));
            counts[cell] += 1.0;
        }
    }
    Zip::from(&sums).and(&counts).map_collect(|&sum, &count| (sum / count.max(1.0)) as f32)
}
