use super::post_filter::blurred;
use crate::resample::{Filter, resize};
use ndarray::{Array2, ArrayView2, Zip, s};

/// Cells along each axis for the statistics of a crop: windows are much wider than a cell.
const CELLS: usize = 28;
/// Least standard deviation of the window, in pixels of the model's input: fewer do not determine a slope.
const LEAST: f64 = 10.0;
/// \\(\varepsilon\\), added to every variance: a standard deviation of 0.01 counts as noise.
const EPSILON: f32 = 1e-4;
/// \\(a_{max}\\): steeper slopes amplify noise.
const STEEPEST: f32 = 3.0;

/// Standard deviation of the regression's window for level n, as a fraction of the crop's sides; `input` is the shorter side of the
/// model's input, where it is known.
pub(super) fn window(n: usize, input: Option<usize>) -> f64 {
    let usual: f64 = if n <= 3 { 6.0 / 28.0 } else { 3.0 / 28.0 };
    input.map_or(usual, |input| usual.max(LEAST / input.max(1) as f64)).min(1.0)
}

/// The change of the map by the prediction of a crop, \\(a L + b - c\\), all `[height, width]`; see the equations in [`augment`](super).
pub(super) fn change(
    prediction: ArrayView2<'_, f32>,
    map: ArrayView2<'_, f32>,
    window: f64,
    exponent: f64,
) -> Array2<f32> {
    let (height, width) = prediction.dim();
    let cells = (CELLS.min(height), CELLS.min(width));
    // Without their means, with which the squares' differences would cancel in f32.
    let [prediction, map] = [prediction, map].map(|values| &values - values.mean().unwrap_or(0.0));
    let smooth = |map: Array2<f32>| {
        let [down, along] = [cells.0, cells.1].map(|side| window * side as f64);
        blurred(map.view(), down, along)
    };
    let [l, c, ll, cc, lc] = block_moments(prediction.view(), map.view(), cells).map(smooth);
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
    let pixels = Zip::from(&slope).and(&offset).and(&prediction).and(&map);
    pixels.map_collect(|a, b, l, c| a * l + b - c)
}

/// Means of \\(L\\), \\(c\\), \\(L^2\\), \\(c^2\\) and \\(L c\\) over a grid of cells.
fn block_moments(
    prediction: ArrayView2<'_, f32>,
    map: ArrayView2<'_, f32>,
    cells: (usize, usize),
) -> [Array2<f32>; 5] {
    let (height, width) = prediction.dim();
    // Cell i has the pixels p with floor(p cells / pixels) = i.
    let pixels = |cell: usize, pixels: usize, cells: usize| {
        (cell * pixels).div_ceil(cells)..((cell + 1) * pixels).div_ceil(cells)
    };
    let means = Array2::from_shape_fn(cells, |(row, column)| {
        let cell = s![pixels(row, height, cells.0), pixels(column, width, cells.1)];
        let (predictions, values) = (prediction.slice(cell), map.slice(cell));
        let mut sums = [0.0_f64; 5];
        for (predictions, values) in predictions.outer_iter().zip(values.outer_iter()) {
            let mut part = [0.0_f32; 5];
            for (&l, &c) in predictions.iter().zip(values) {
                part.iter_mut().zip([l, c, l * l, c * c, l * c]).for_each(|(sum, value)| *sum += value);
            }
            sums.iter_mut().zip(part).for_each(|(sum, part)| *sum += f64::from(part));
        }
        sums.map(|sum| (sum / values.len().max(1) as f64) as f32)
    });
    std::array::from_fn(|moment| means.mapv(|means| means[moment]))
}
