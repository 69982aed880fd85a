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
/// \\[ w(x, y) = \exp\left(-\frac{\\|x - y\\|^2}{2\sigma_s^2} - \frac{\\|I_x - I_y\\|^2}{2\sigma_c^2}\right). \\]
///
/// ```
/// use mde_uncertainty::filter::JointBilateral;
/// use mde_uncertainty::ndarray::array;
///
/// // The step of the map moves to that of the guide.
/// let guide = [array![[0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0]]];
/// let map = array![[1.0_f32, 1.0, 2.0, 2.0, 2.0, 2.0]];
/// let filtered = JointBilateral::dense(2.0, 0.1).filter(map.view(), None, &guide)?;
/// assert!(filtered[(0, 2)] < 1.5 && (filtered[(0, 3)] - 2.0).abs() < 1e-6);
/// # Ok::<(), mde_uncertainty::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointBilateral {
    taps: Vec<Tap>,
    /// \\(1 / (2 \sigma_c^2)\\).
    falloff: f32,
    dense: bool,
}

/// A neighbour of a pixel, and its weight by nearness in place.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    down: isize,
    across: isize,
    weight: f32,
}

impl JointBilateral {
    /// Every pixel within two `sigma` (\\(\sigma_s\\), pixels) to each side; pixels beyond the border are left out. `colour` is
    /// \\(\sigma_c\\), in the guide's unit. Time grows with the square of `sigma`.
    #[must_use]
    pub fn dense(sigma: f64, colour: f64) -> Self {
        let steps = (2.0 * sigma).ceil() as isize;
        Self { taps: taps(sigma, steps, sigma.recip()), falloff: falloff(colour), dense: true }
    }

    /// A grid of 5 x 5 pixels, 3/4 of `sigma` apart; the border is repeated.
    #[must_use]
    pub fn sparse(sigma: f64, colour: f64) -> Self {
        Self { taps: taps(sigma, 2, 0.75), falloff: falloff(colour), dense: false }
    }

    /// The filtered map, `[height, width]`. `guide` has the channels of an image of the map's size. Pixels where `support` is 0 have no
    /// weight, but must be finite too; a pixel without any weight around it keeps its value.
    ///
    /// # Errors
    /// [`Error::Size`] where support or guide have another size.
    pub fn filter(
        &self,
        map: ArrayView2<'_, f32>,
        support: Option<ArrayView2<'_, f32>>,
        guide: &[Array2<f32>],
    ) -> Result<Array2<f32>> {
        let rows = self.rows(map, support, guide)?;
        let mut out = Array2::zeros(map.dim());
        if let Some(values) = out.as_slice_mut() {
            values.chunks_mut(map.ncols().max(1)).enumerate().for_each(|(y, row)| rows(y, row));
        }
        Ok(out)
    }

    /// The same row by row, for a caller that filters rows in parallel: the function writes a row of the filtered map, nothing where there is
    /// no such row.
    ///
    /// # Errors
    /// As [`filter`](Self::filter).
    pub fn rows<'m>(
        &'m self,
        map: ArrayView2<'m, f32>,
        support: Option<ArrayView2<'m, f32>>,
        guide: &'m [Array2<f32>],
    ) -> Result<impl Fn(usize, &mut [f32]) + 'm> {
        let supports = support.iter().map(|support| ("the support", support.dim()));
        for (what, found) in supports.chain(guide.iter().map(|channel| ("the guide", channel.dim()))) {
            if found != map.dim() {
                return Err(Error::Size { what, found, expected: map.dim() });
            }
        }
        let Self { taps, falloff, dense } = self;
        let (height, width) = map.dim();
        Ok(move |y: usize, out: &mut [f32]| {
            if y >= height || width == 0 {
                return;
            }
            let (mut sum, mut total) = (vec![0.0_f32; width], vec![0.0_f32; width]);
            let (mut weights, mut there) = (vec![0.0_f32; width], vec![0.0_f32; width]);
            let here: Vec<Cow<'_, [f32]>> = guide.iter().map(|channel| line(channel.row(y))).collect();
            for tap in taps {
                let row = match y.checked_add_signed(tap.down) {
                    Some(row) if row < height => row,
                    _ if *dense => continue,
                    Some(_) => height - 1,
                    None => 0,
                };
                // The pixels that take part: in a dense filter those whose neighbour is in the map.
                let pixels = if *dense { within(tap.across, width) } else { 0..width };
                let (weights, there) = (&mut weights[pixels.clone()], &mut there);
                weights.fill(0.0);
                for (channel, here) in guide.iter().zip(&here) {
                    shift(channel.row(row), tap.across, there);
                    let pairs = there[pixels.clone()].iter().zip(&here[pixels.clone()]);
                    weights.iter_mut().zip(pairs).for_each(|(sum, (t, h))| *sum += (t - h) * (t - h));
                }
                weights.iter_mut().for_each(|w| *w = tap.weight * approximate_exp(*w * falloff));
                if let Some(support) = support {
                    shift(support.row(row), tap.across, there);
                    weights.iter_mut().zip(&there[pixels.clone()]).for_each(|(w, known)| *w *= known);
                }
                shift(map.row(row), tap.across, there);
                let values = weights.iter().zip(&there[pixels.clone()]);
                let sums = sum[pixels.clone()].iter_mut().zip(&mut total[pixels]);
                sums.zip(values).for_each(|((sum, total), (&w, &v))| {
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

/// The pixels of a row of so many whose neighbour `across` is in it.
fn within(across: isize, width: usize) -> std::ops::Range<usize> {
    let first = across.min(0).unsigned_abs().min(width);
    first..(width - across.max(0).unsigned_abs().min(width)).max(first)
}

/// The neighbours `across` of a row's pixels, with the border repeated.
fn shift(row: ArrayView1<'_, f32>, across: isize, out: &mut [f32]) {
    let width = row.len();
    let pixels = within(across, width);
    let from = pixels.start.saturating_add_signed(across).min(width);
    out[..pixels.start].fill(row[0]);
    out[pixels.end..].fill(row[width - 1]);
    let count = pixels.len();
    out[pixels].copy_from_slice(&line(row)[from..][..count]);
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

fn falloff(colour: f64) -> f32 {
    (0.5 / (colour * colour)) as f32
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

        /// A weighted mean stays between its values, and a constant guide makes it a plain mean: constants stay.
        #[test]
        fn a_bilateral_filter_stays_within_the_range(map in any_map(), sigma in 0.3_f64..3.0, dense: bool) {
            let map = map.mapv(|v| v as f32);
            let filter = if dense { JointBilateral::dense(sigma, 0.1) } else { JointBilateral::sparse(sigma, 0.1) };
            let guide = [map.mapv(|v| 0.05 * v)];
            let filtered = filter.filter(map.view(), None, &guide)?;
            let (low, high) = map.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
            prop_assert!(filtered.iter().all(|v| (low - 1e-5..=high + 1e-5).contains(v)));
            let support = Array2::zeros(map.dim());
            prop_assert_eq!(filter.filter(map.view(), Some(support.view()), &guide)?, map);
        }
    }

    #[test]
    fn without_support_a_pixel_has_no_weight() {
        let map = ndarray::array![[1.0_f32, 100.0, 1.0]];
        let support = ndarray::array![[1.0_f32, 0.0, 1.0]];
        let filtered = JointBilateral::dense(1.0, 0.1)
            .filter(map.view(), Some(support.view()), &[Array2::zeros((1, 3))])
            .unwrap();
        assert!(filtered.iter().all(|v| (v - 1.0).abs() < 1e-6), "{filtered}");
    }
}
