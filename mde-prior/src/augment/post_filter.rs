//! The post-filter: an unsharp mask and a joint bilateral filter, limited to the detail that the crops added.

use crate::filter::gaussian_blur;
use ndarray::{Array2, ArrayView2, ArrayView3, Axis, Zip};

/// Steps of the bilateral filter to each side, and their length in standard deviations.
const STEPS: isize = 2;
const STRIDE: f64 = 0.75;
/// Standard deviation of the blur of the image before it is compared, in pixels: sensor noise makes no edges.
const NOISE: f64 = 0.7;
/// Standard deviation of the bilateral filter in colour (0 to 1).
const COLOUR: f64 = 0.1;

/// Unsharp mask: \\(c + k (c - G_\sigma c)\\).
pub(super) fn sharpened(map: Array2<f32>, sigma: f64, gain: f64) -> Array2<f32> {
    let low = gaussian_blur(map.view(), (sigma, sigma));
    Zip::from(&map).and(&low).map_collect(|&c, &low| c + gain as f32 * (c - low))
}

/// Moves `map` towards `filtered`, limited by the detail that the crops `added` nearby:
/// \\(c + \delta \min(1, \sqrt{G_{2\sigma} f^2 / G_{2\sigma} \delta^2})\\) with \\(\delta\\) the change by the filter and \\(f\\) the change by
/// the crops, less its low frequencies \\(G_\sigma\\).
pub(super) fn limit(map: &mut Array2<f32>, filtered: &Array2<f32>, added: ArrayView2<'_, f32>, sigma: f64) {
    let change = filtered - &*map;
    let low = gaussian_blur(added, (sigma, sigma));
    let energy = |of: Array2<f32>| gaussian_blur(of.mapv(|v| v * v).view(), (2.0 * sigma, 2.0 * sigma));
    let (allowed, wanted) = (energy(&added - &low), energy(change.clone()));
    Zip::from(map).and(&change).and(&allowed).and(&wanted).for_each(|c, &d, &allowed, &wanted| {
        let fraction = if wanted > allowed { (allowed.max(0.0) / wanted).sqrt() } else { 1.0 };
        *c += fraction * d;
    });
}

/// Joint bilateral filter (Petschnigg et al., 2004) on a sparse grid of taps.
pub(super) fn bilateral(map: ArrayView2<'_, f32>, image: ArrayView3<'_, f32>, sigma: f64) -> Array2<f32> {
    let (height, width) = map.dim();
    let guide: Vec<Array2<f32>> =
        image.axis_iter(Axis(2)).map(|channel| gaussian_blur(channel, (NOISE, NOISE))).collect();
    let range = (0.5 / (COLOUR * COLOUR)) as f32;
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
