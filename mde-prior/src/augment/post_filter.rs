//! The post-filter: an unsharp mask and a joint bilateral filter, limited to the detail that the crops added.

use crate::resample::{Filter, resize};
use crate::{Error, Result};
use mde_uncertainty::filter::{Border, Gaussian, JointBilateral, gaussian_blur};
use ndarray::{Array2, ArrayView2, ArrayView3, Axis, Zip};
use rayon::prelude::*;

/// Standard deviations at which Gaussians are cut off.
const CUT: f64 = 3.0;
/// Standard deviation of the blur of the image before it is compared, in pixels: sensor noise makes no edges.
const NOISE: f64 = 0.7;
/// Standard deviation of the bilateral filter in colour (0 to 1).
const COLOUR: f64 = 0.1;
/// Standard deviation of a wide Gaussian in pixels of the smaller map on which it is applied.
const COARSE: f64 = 3.0;

/// Unsharp mask: \\(c + k (c - G_\sigma c)\\).
pub(super) fn sharpened(map: Array2<f32>, sigma: f64, gain: f64) -> Array2<f32> {
    let low = wide(map.view(), sigma);
    Zip::from(&map).and(&low).map_collect(|&c, &low| c + gain as f32 * (c - low))
}

/// Moves `map` towards `filtered`, limited by the detail that the crops `added` nearby, as in [`augment`](super): the low frequencies are
/// those of \\(G_\sigma\\), and nearby is within \\(G_{2\sigma}\\).
pub(super) fn limit(map: &mut Array2<f32>, filtered: &Array2<f32>, added: ArrayView2<'_, f32>, sigma: f64) {
    let change = filtered - &*map;
    let low = wide(added, sigma);
    let energy = |of: Array2<f32>| wide(of.mapv(|v| v * v).view(), 2.0 * sigma);
    let (allowed, wanted) = (energy(&added - &low), energy(change.clone()));
    Zip::from(map).and(&change).and(&allowed).and(&wanted).for_each(|c, &d, &allowed, &wanted| {
        let fraction = if wanted > allowed { (allowed.max(0.0) / wanted).sqrt() } else { 1.0 };
        *c += fraction * d;
    });
}

/// Joint bilateral filter with a Gaussian of `sigma` pixels.
///
/// # Errors
/// [`crate::Error::Input`] for an image of another size.
pub(super) fn bilateral(
    map: ArrayView2<'_, f32>,
    image: ArrayView3<'_, f32>,
    sigma: f64,
) -> Result<Array2<f32>> {
    let guide: Vec<Array2<f32>> =
        image.axis_iter(Axis(2)).map(|channel| blurred(channel, NOISE, NOISE)).collect();
    let filter = JointBilateral::new(sigma, COLOUR);
    let rows = filter.rows(map, &guide).map_err(|e| Error::Input(e.to_string()))?;
    let mut filtered = Array2::zeros(map.dim());
    if let Some(values) = filtered.as_slice_mut() {
        let width = map.ncols().max(1);
        values.par_chunks_mut(width).enumerate().for_each(|(y, row)| rows(y, row));
    }
    Ok(filtered)
}

/// Gaussian blur with a standard deviation of many pixels, in time that does not grow with it: the map is reduced, blurred, and
/// interpolated.
fn wide(map: ArrayView2<'_, f32>, sigma: f64) -> Array2<f32> {
    let (height, width) = map.dim();
    let factor = sigma / COARSE;
    if factor < 2.0 {
        return blurred(map, sigma, sigma);
    }
    let side = |pixels: usize| ((pixels as f64 / factor).round() as usize).max(1);
    let (rows, columns) = (side(height), side(width));
    let small = resize(map, (rows, columns), Filter::BilinearAntialias);
    // The two triangles, of half width one cell each, have a variance of 1/6 of a cell squared each.
    let rest = |pixels: usize, cells: usize| {
        let sigma = sigma * cells as f64 / pixels as f64;
        (sigma * sigma - 1.0 / 3.0).max(0.0).sqrt()
    };
    let small = blurred(small.view(), rest(height, rows), rest(width, columns));
    resize(small.view(), (height, width), Filter::Bilinear)
}

/// Gaussian blur with standard deviations down the columns and along the rows, in pixels.
pub(super) fn blurred(map: ArrayView2<'_, f32>, down: f64, along: f64) -> Array2<f32> {
    gaussian_blur(map, Gaussian::new(down, CUT), Gaussian::new(along, CUT), Border::Mirror)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wide_gaussian_on_a_smaller_map_is_the_gaussian() {
        let map = Array2::from_shape_fn((120, 160), |(y, x)| f32::from(u8::from((x / 40 + y / 30) % 2 == 0)));
        for sigma in [6.5, 9.0, 20.0] {
            let (exact, fast) = (blurred(map.view(), sigma, sigma), wide(map.view(), sigma));
            let most = exact.iter().zip(&fast).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most < 0.02, "{sigma}: {most}");
        }
    }
}
