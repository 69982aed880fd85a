//! The last touch: a little contrast, and edges where the picture has them.

use ndarray::{Array2, ArrayView2, ArrayView3, Axis, Zip};

/// Steps of the bilateral filter to each side, and their length in standard deviations.
const STEPS: isize = 2;
const STRIDE: f64 = 0.75;
/// The picture is smoothed by so many pixels first: a sensor's noise is no edge.
const NOISE: f64 = 0.7;

/// Unsharp mask: \\(c + k (c - G_\sigma c)\\).
pub(super) fn sharpened(map: Array2<f32>, sigma: f64, gain: f64) -> Array2<f32> {
    let low = blurred(map.view(), (sigma, sigma));
    Zip::from(&map).and(&low).map_collect(|&c, &low| c + gain as f32 * (c - low))
}

/// Moves `map` towards `touched`, but around each pixel no further than the evidence moved the detail there:
/// \\(c + \delta \min(1, \sqrt{G_{2\sigma} f^2 / G_{2\sigma} \delta^2})\\) with \\(\delta\\) the touch and \\(f\\) what was `found`, less its low
/// frequencies \\(G_\sigma\\).
pub(super) fn allow(map: &mut Array2<f32>, touched: &Array2<f32>, found: ArrayView2<'_, f32>, sigma: f64) {
    let touch = touched - &*map;
    let low = blurred(found, (sigma, sigma));
    let energy = |of: Array2<f32>| blurred(of.mapv(|v| v * v).view(), (2.0 * sigma, 2.0 * sigma));
    let (found, wanted) = (energy(&found - &low), energy(touch.clone()));
    Zip::from(map).and(&touch).and(&found).and(&wanted).for_each(|c, &d, &found, &wanted| {
        let share = if wanted > found { (found.max(0.0) / wanted).sqrt() } else { 1.0 };
        *c += share * d;
    });
}

/// Joint bilateral filter (Petschnigg et al., 2004) on a sparse grid of taps.
pub(super) fn snapped(
    map: ArrayView2<'_, f32>,
    image: ArrayView3<'_, f32>,
    sigma: f64,
    colour: f64,
) -> Array2<f32> {
    let (height, width) = map.dim();
    let guide: Vec<Array2<f32>> =
        image.axis_iter(Axis(2)).map(|channel| blurred(channel, (NOISE, NOISE))).collect();
    let range = (0.5 / (colour * colour)) as f32;
    let step = |i: isize| (i as f64 * STRIDE * sigma).round() as isize;
    let mut sum = Array2::<f32>::zeros(map.dim());
    let mut total = Array2::<f32>::zeros(map.dim());
    for (down, across) in (-STEPS..=STEPS).flat_map(|i| (-STEPS..=STEPS).map(move |j| (i, j))) {
        let (dy, dx) = (step(down), step(across));
        let near = (-0.5 * STRIDE * STRIDE * (down * down + across * across) as f64).exp() as f32;
        let at = |i: usize, d: isize, side: usize| i.saturating_add_signed(d).min(side - 1);
        for y in 0..height {
            let there = at(y, dy, height);
            for x in 0..width {
                let other = (there, at(x, dx, width));
                let distance: f32 = guide.iter().map(|g| (g[other] - g[(y, x)]).powi(2)).sum();
                let weight = near * (-distance * range).exp();
                sum[(y, x)] += weight * map[other];
                total[(y, x)] += weight;
            }
        }
    }
    // The pixel itself has weight 1.
    Zip::from(&sum).and(&total).map_collect(|s, t| s / t)
}

/// Gaussian blur with standard deviations down and across, in pixels; borders are mirrored.
#[must_use]
pub fn blurred(map: ArrayView2<'_, f32>, (down, across): (f64, f64)) -> Array2<f32> {
    let mut out = map.to_owned();
    for (axis, sigma) in [(Axis(0), down), (Axis(1), across)] {
        let kernel = kernel(sigma);
        if kernel.len() == 1 {
            continue;
        }
        let source = out.clone();
        let length = source.len_of(axis);
        let reach = kernel.len() / 2;
        for i in 0..length {
            let mut line = out.index_axis_mut(axis, i);
            line.fill(0.0);
            for (k, &weight) in kernel.iter().enumerate() {
                let from =
                    source.index_axis(axis, mirrored(i as isize + k as isize - reach as isize, length));
                line.zip_mut_with(&from, |sum, &v| *sum += weight * v);
            }
        }
    }
    out
}

/// Normalised, cut at three standard deviations; a single 1 for none.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = if sigma > 0.0 { (3.0 * sigma).ceil() as i64 } else { 0 };
    let weights: Vec<f64> =
        (-reach..=reach).map(|i| (-0.5 * (i as f64 / sigma.max(1e-9)).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / total) as f32).collect()
}

/// The index behind a border, counted back from it.
fn mirrored(i: isize, length: usize) -> usize {
    let period = 2 * length as isize;
    let i = i.rem_euclid(period);
    (if i < length as isize { i } else { period - 1 - i }) as usize
}
