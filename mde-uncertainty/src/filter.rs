//! Filters of maps `[height, width]`: a separable Gaussian blur and a joint bilateral filter.

mod upsample;

pub use upsample::JointUpsampling;

use crate::{Error, Real, Result};
use ndarray::{Array2, ArrayView1, ArrayView2};
use std::borrow::Cow;

/// Values beyond the border of a map that is blurred.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Border {
    /// The map, mirrored; the border pixel is repeated.
    Mirror,
    /// Zeros. The ratio of a blurred map to its blurred mask is a normalised convolution.
    Zero,
}

/// A Gaussian along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Standard deviation, pixels; 0 for no blur.
    pub sigma: f64,
    /// Pixels to each side at which the kernel is cut off.
    pub radius: usize,
}

impl Gaussian {
    /// Largest radius of [`new`](Self::new), beyond any map.
    pub const WIDEST: usize = 1 << 20;

    /// A Gaussian that is cut off at `cut` standard deviations, rounded up, and at [`WIDEST`](Self::WIDEST) pixels.
    #[must_use]
    pub fn new(sigma: f64, cut: f64) -> Self {
        let radius = if sigma > 0.0 { ((cut * sigma).ceil() as usize).min(Self::WIDEST) } else { 0 };
        Self { sigma, radius }
    }

    /// Weights from \\(-r\\) to \\(r\\) with sum 1.
    fn kernel<T: Real>(self) -> Vec<T> {
        let reach = self.radius as i64;
        let weight = |i: i64| (-0.5 * (i as f64 / self.sigma.max(1e-9)).powi(2)).exp();
        let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
        let total: f64 = weights.iter().sum();
        weights.iter().map(|w| T::from_f64(w / total)).collect()
    }
}

/// Separable Gaussian blur with a Gaussian down the columns and one along the rows. The sums have a fixed order.
///
/// ```
/// use mde_uncertainty::filter::{Border, Gaussian, gaussian_blur};
/// use mde_uncertainty::ndarray::array;
///
/// let none = Gaussian::new(0.0, 3.0);
/// let narrow = Gaussian { sigma: 1.0, radius: 1 };
/// let blurred = gaussian_blur(array![[0.0_f64, 1.0, 0.0]].view(), none, narrow, Border::Mirror);
/// assert!((blurred[(0, 0)] - 0.274).abs() < 1e-3 && (blurred[(0, 1)] - 0.452).abs() < 1e-3);
/// ```
#[must_use]
pub fn gaussian_blur<T: Real>(
    map: ArrayView2<'_, T>,
    down: Gaussian,
    along: Gaussian,
    border: Border,
) -> Array2<T> {
    let (height, width) = map.dim();
    let mut values: Vec<T> = map.iter().copied().collect();
    if width > 0 && down.radius > 0 {
        let kernel: Vec<T> = down.kernel();
        let source = values.clone();
        let mut parts = Vec::with_capacity(kernel.len());
        for (y, line) in values.chunks_exact_mut(width).enumerate() {
            parts.clear();
            for (k, &weight) in kernel.iter().enumerate() {
                let from = y as isize + k as isize - down.radius as isize;
                let from = match border {
                    Border::Mirror => mirrored(from, height),
                    Border::Zero if (0..height as isize).contains(&from) => from as usize,
                    Border::Zero => continue,
                };
                parts.push((weight, &source[from * width..(from + 1) * width]));
            }
            weighted_sum(&parts, line);
        }
    }
    if width > 0 && along.radius > 0 {
        let kernel: Vec<T> = along.kernel();
        let reach = along.radius;
        let mut padded = vec![T::ZERO; width + 2 * reach];
        for line in values.chunks_exact_mut(width) {
            padded[reach..reach + width].copy_from_slice(line);
            if border == Border::Mirror {
                for at in (0..reach).chain(reach + width..width + 2 * reach) {
                    padded[at] = line[mirrored(at as isize - reach as isize, width)];
                }
            }
            let parts: Vec<(T, &[T])> =
                kernel.iter().enumerate().map(|(k, &weight)| (weight, &padded[k..k + width])).collect();
            weighted_sum(&parts, line);
        }
    }
    // There are as many as the map has.
    Array2::from_shape_vec((height, width), values).unwrap_or_default()
}

/// Values that are summed at once: the sums stay in registers.
const BLOCK: usize = 16;

/// The sum of the parts times their weights, in their order; each has the length of `out`.
fn weighted_sum<T: Real>(parts: &[(T, &[T])], out: &mut [T]) {
    let whole = out.len() - out.len() % BLOCK;
    let (blocks, rest) = out.as_chunks_mut::<BLOCK>();
    for (index, block) in blocks.iter_mut().enumerate() {
        let mut sums = [T::ZERO; BLOCK];
        for &(weight, part) in parts {
            let part = &part[index * BLOCK..][..BLOCK];
            sums.iter_mut().zip(part).for_each(|(sum, &value)| *sum += weight * value);
        }
        *block = sums;
    }
    rest.fill(T::ZERO);
    for &(weight, part) in parts {
        rest.iter_mut().zip(&part[whole..]).for_each(|(sum, &value)| *sum += weight * value);
    }
}

/// The index inside of a mirrored border.
fn mirrored(i: isize, length: usize) -> usize {
    let period = 2 * length as isize;
    let i = i.rem_euclid(period);
    (if i < length as isize { i } else { period - 1 - i }) as usize
}

/// Joint bilateral filter (Petschnigg et al., 2004): the mean of a map weighted by nearness in place and in the colour of a guide,
///
/// \\[ w(x, y) = \exp\left(-\frac{\\|x - y\\|^2}{2\sigma_s^2} - \frac{\\|I_x - I_y\\|^2}{2\sigma_c^2}\right), \\]
///
/// over a grid of 5 x 5 pixels, 3/4 of \\(\sigma_s\\) apart; the border is repeated.
///
/// ```
/// use mde_uncertainty::filter::JointBilateral;
/// use mde_uncertainty::ndarray::array;
///
/// // The step of the map moves to that of the guide.
/// let guide = [array![[0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0]]];
/// let map = array![[1.0_f32, 1.0, 2.0, 2.0, 2.0, 2.0]];
/// let (filter, mut filtered) = (JointBilateral::new(2.0, 0.1), [0.0; 6]);
/// filter.rows(map.view(), &guide)?(0, &mut filtered);
/// assert!(filtered[2] < 1.5 && (filtered[3] - 2.0).abs() < 1e-6);
/// # Ok::<(), mde_uncertainty::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointBilateral {
    taps: Vec<Tap>,
    /// \\(1 / (2 \sigma_c^2)\\).
    falloff: f32,
}

/// A neighbour of a pixel, and its weight by nearness in place.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    down: isize,
    across: isize,
    weight: f32,
}

impl JointBilateral {
    /// With \\(\sigma_s\\) of `sigma` pixels, and \\(\sigma_c\\) of `colour` in the guide's unit.
    #[must_use]
    pub fn new(sigma: f64, colour: f64) -> Self {
        Self { taps: taps(sigma, 2, 0.75), falloff: (0.5 / (colour * colour)) as f32 }
    }

    /// The filter of a map `[height, width]` row by row, which the caller may run in parallel: the function writes a row of the result, nothing
    /// where there is no such row. `guide` has the channels of an image of the map's size.
    ///
    /// # Errors
    /// [`Error::Size`] where the guide has another size.
    pub fn rows<'m>(
        &'m self,
        map: ArrayView2<'m, f32>,
        guide: &'m [Array2<f32>],
    ) -> Result<impl Fn(usize, &mut [f32]) + 'm> {
        if let Some(found) = guide.iter().map(|channel| channel.dim()).find(|found| *found != map.dim()) {
            return Err(Error::Size { what: "the guide", found, expected: map.dim() });
        }
        let Self { taps, falloff } = self;
        let (height, width) = map.dim();
        Ok(move |y: usize, out: &mut [f32]| {
            if y >= height || width == 0 {
                return;
            }
            let (mut sum, mut total) = (vec![0.0_f32; width], vec![0.0_f32; width]);
            let (mut weights, mut there) = (vec![0.0_f32; width], vec![0.0_f32; width]);
            let here: Vec<Cow<'_, [f32]>> = guide.iter().map(|channel| line(channel.row(y))).collect();
            for tap in taps {
                let row = y.saturating_add_signed(tap.down).min(height - 1);
                weights.fill(0.0);
                for (channel, here) in guide.iter().zip(&here) {
                    shift(channel.row(row), tap.across, &mut there);
                    let pairs = there.iter().zip(&**here);
                    weights.iter_mut().zip(pairs).for_each(|(sum, (t, h))| *sum += (t - h) * (t - h));
                }
                weights.iter_mut().for_each(|w| *w = tap.weight * approximate_exp(*w * falloff));
                shift(map.row(row), tap.across, &mut there);
                let sums = sum.iter_mut().zip(&mut total);
                sums.zip(weights.iter().zip(&there)).for_each(|((sum, total), (&w, &v))| {
                    *sum += w * v;
                    *total += w;
                });
            }
            for (x, out) in out.iter_mut().enumerate().take(width) {
                *out = if total[x] > 0.0 { sum[x] / total[x] } else { map[(y, x)] };
            }
        })
    }
}

/// The neighbours `across` of a row's pixels, with the border repeated.
fn shift(row: ArrayView1<'_, f32>, across: isize, out: &mut [f32]) {
    let width = row.len();
    let [before, after] = [-across, across].map(|beyond| beyond.max(0).unsigned_abs().min(width));
    out[..before].fill(row[0]);
    out[width - after..].fill(row[width - 1]);
    let count = width - before - after;
    out[before..][..count].copy_from_slice(&line(row)[after..][..count]);
}

/// A row as a slice, copied only where its values do not lie side by side.
#[must_use]
pub fn line(row: ArrayView1<'_, f32>) -> Cow<'_, [f32]> {
    row.to_slice().map_or_else(|| Cow::Owned(row.to_vec()), Cow::Borrowed)
}

/// `steps` to each side, `stride` standard deviations apart.
fn taps(sigma: f64, steps: isize, stride: f64) -> Vec<Tap> {
    let offset = |i: isize| (i as f64 * stride * sigma).round() as isize;
    let pairs = (-steps..=steps).flat_map(|down| (-steps..=steps).map(move |across| (down, across)));
    let tap = |(down, across): (isize, isize)| Tap {
        down: offset(down),
        across: offset(across),
        weight: (-0.5 * stride * stride * (down * down + across * across) as f64).exp() as f32,
    };
    pairs.map(tap).collect()
}

/// \\(e^{-u}\\) as \\((1 - u/n)^n\\) with \\(n = 2^{10}\\), which is off by less than \\(u^2/n\\) of itself and needs no branch.
fn approximate_exp(u: f32) -> f32 {
    let mut factor = (1.0 - u / 1024.0).max(0.0);
    for _ in 0..10 {
        factor *= factor;
    }
    factor
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::proptest::prelude::*;

    fn any_map() -> impl Strategy<Value = Array2<f64>> {
        (1_usize..9, 1_usize..9).prop_flat_map(|(h, w)| {
            ::proptest::collection::vec(-5.0_f64..5.0, h * w)
                .prop_map(move |v| Array2::from_shape_vec((h, w), v).unwrap())
        })
    }

    proptest! {
        /// A mirrored border keeps the sum, and the extremes bound the result.
        #[test]
        fn a_blur_keeps_the_mean_and_the_range(map in any_map(), sigma in 0.0_f64..4.0) {
            let gaussian = Gaussian::new(sigma, 3.0);
            let blurred = gaussian_blur(map.view(), gaussian, gaussian, Border::Mirror);
            prop_assert!((blurred.sum() - map.sum()).abs() < 1e-9);
            let (low, high) = map.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
            prop_assert!(blurred.iter().all(|v| (low - 1e-12..=high + 1e-12).contains(v)));
        }

        /// Rows and columns are treated alike.
        #[test]
        fn a_blur_commutes_with_the_transpose(map in any_map(), sigma in 0.0_f64..4.0, zero: bool) {
            let border = if zero { Border::Zero } else { Border::Mirror };
            let (a, b) = (Gaussian::new(sigma, 4.0), Gaussian::new(0.7, 3.0));
            let one = gaussian_blur(map.view(), a, b, border);
            let other = gaussian_blur(map.t(), b, a, border);
            for (x, y) in one.iter().zip(&other.t()) {
                prop_assert!((x - y).abs() < 1e-12);
            }
        }

        /// A weighted mean stays between its values.
        #[test]
        fn a_bilateral_filter_stays_within_the_range(map in any_map(), sigma in 0.3_f64..3.0) {
            let map = map.mapv(|v| v as f32);
            let guide = [map.mapv(|v| 0.05 * v)];
            let (filter, mut filtered) = (JointBilateral::new(sigma, 0.1), map.clone());
            let rows = filter.rows(map.view(), &guide)?;
            filtered.outer_iter_mut().enumerate().for_each(|(y, mut row)| rows(y, row.as_slice_mut().unwrap()));
            let (low, high) = map.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
            prop_assert!(filtered.iter().all(|v| (low - 1e-5..=high + 1e-5).contains(v)));
        }
    }
}
