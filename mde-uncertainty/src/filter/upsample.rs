use crate::{Error, Result};
use ndarray::{Array2, ArrayView1, ArrayView2};

/// Standard deviation of the nearness in place, in pixels of the small map.
const NEAR: f64 = 0.75;
/// Taps along each axis.
const TAPS: usize = 4;
/// Added to the weight of colour: where no neighbour has the pixel's colour, nearness decides.
const FLOOR: f32 = 1e-4;

/// Joint bilateral upsampling (Kopf et al., 2007): maps are brought to the size of a larger guide, with their edges where the guide has
/// them. A pixel is the mean of the 4 x 4 nearest values of the small map,
///
/// \\[ w(x, y) = \exp\left(-\frac{\\|x_\downarrow - y\\|^2}{2\sigma_s^2}\right) \exp\left(-\frac{\\|I_x - I_y\\|^2}{2\sigma_c^2}\right), \\]
///
/// with \\(x_\downarrow\\) the pixel's place in the small map, \\(\sigma_s\\) = 0.75 pixels of it, and \\(I\\) the colours of the large guide
/// at \\(x\\), of the small one at \\(y\\).
///
/// ```
/// use mde_uncertainty::filter::JointUpsampling;
/// use mde_uncertainty::ndarray::array;
///
/// // The step of the map lies within its second pixel; the large guide has its place.
/// let (small, large) = ([array![[0.0_f32, 0.5, 1.0]]], [array![[0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0]]]);
/// let upsampling = JointUpsampling::new(&small, &large, 0.1)?;
/// let mut row = [0.0; 6];
/// upsampling.row(&[array![[2.0_f32, 2.0, 4.0]].view()], 0, &mut [&mut row])?;
/// assert!((row[2] - 2.0).abs() < 0.01 && (row[5] - 4.0).abs() < 0.01);
/// # Ok::<(), mde_uncertainty::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct JointUpsampling<'g> {
    small: &'g [Array2<f32>],
    large: &'g [Array2<f32>],
    falloff: f32,
    /// Taps of each large column.
    columns: Vec<Taps>,
}

/// The four taps of a large row or column: indices in the small map and weights.
type Taps = ([usize; TAPS], [f32; TAPS]);

impl<'g> JointUpsampling<'g> {
    /// `small` and `large` have the channels of one image at the size of the maps and at that of the result. `colour` is
    /// \\(\sigma_c\\), in the guide's unit.
    ///
    /// # Errors
    /// [`Error::Size`] for channels of several sizes, or an empty one.
    pub fn new(small: &'g [Array2<f32>], large: &'g [Array2<f32>], colour: f64) -> Result<Self> {
        for channels in [small, large] {
            let expected = channels.first().map_or((1, 1), |first| first.dim());
            let found = channels.iter().map(|channel| channel.dim()).find(|size| *size != expected);
            if let Some(found) = found.or((expected.0 * expected.1 == 0).then_some(expected)) {
                return Err(Error::Size { what: "the guide", found, expected });
            }
        }
        let width = |channels: &[Array2<f32>]| channels.first().map_or(0, |channel| channel.ncols());
        let (from, to) = (width(small), width(large));
        let columns = (0..to).map(|x| taps(x, from, to)).collect();
        Ok(Self { small, large, falloff: (0.5 / (colour * colour)) as f32, columns })
    }

    /// Writes row `y` of each map's larger version to `out`, one row per map. A value that is not finite or not positive is missing and
    /// has no weight; a pixel without any value is missing in the result: 0.
    ///
    /// # Errors
    /// [`Error::Size`] where maps or rows have another size than the guides.
    pub fn row(&self, maps: &[ArrayView2<'_, f32>], y: usize, out: &mut [&mut [f32]]) -> Result<()> {
        let size = |channels: &[Array2<f32>]| channels.first().map(|channel| channel.dim());
        let (Some((rows, columns)), Some((height, width))) = (size(self.small), size(self.large)) else {
            return Ok(());
        };
        if let Some(map) = maps.iter().find(|map| map.dim() != (rows, columns)) {
            return Err(Error::Size { what: "the map", found: map.dim(), expected: (rows, columns) });
        }
        if let Some(row) = out.iter().find(|row| row.len() != width) {
            return Err(Error::Size { what: "the row", found: (1, row.len()), expected: (1, width) });
        }
        if y >= height {
            return Ok(());
        }
        let (from, down) = taps(y, rows, height);
        let four = |map: ArrayView2<'_, f32>| from.map(|row| map.row(row).to_vec());
        let small: Vec<[Vec<f32>; TAPS]> = self.small.iter().map(|channel| four(channel.view())).collect();
        let large: Vec<ArrayView1<'_, f32>> = self.large.iter().map(|channel| channel.row(y)).collect();
        let maps: Vec<[Vec<f32>; TAPS]> = maps.iter().map(|map| four(*map)).collect();
        for (x, (at, across)) in self.columns.iter().enumerate() {
            let mut weights = [[0.0_f32; TAPS]; TAPS];
            for (k, weights) in weights.iter_mut().enumerate() {
                let mut squared = [0.0_f32; TAPS];
                for (small, large) in small.iter().zip(&large) {
                    let (values, colour) = (values(&small[k], at), large[x]);
                    squared = std::array::from_fn(|i| squared[i] + (values[i] - colour).powi(2));
                }
                *weights = std::array::from_fn(|i| {
                    down[k] * across[i] * (super::approximate_exp(squared[i] * self.falloff) + FLOOR)
                });
            }
            for (map, out) in maps.iter().zip(out.iter_mut()) {
                let (mut sums, mut totals) = ([0.0_f32; TAPS], [0.0_f32; TAPS]);
                for (weights, row) in weights.iter().zip(map) {
                    let values = values(row, at);
                    // Without a branch, for vector registers.
                    let known = values.map(|value| value > 0.0 && value <= f32::MAX);
                    let or_0 = |i: usize, value: f32| if known[i] { value } else { 0.0 };
                    let weights: [f32; TAPS] = std::array::from_fn(|i| or_0(i, weights[i]));
                    let values: [f32; TAPS] = std::array::from_fn(|i| or_0(i, values[i]));
                    sums = std::array::from_fn(|i| sums[i] + weights[i] * values[i]);
                    totals = std::array::from_fn(|i| totals[i] + weights[i]);
                }
                let (sum, total) = (sums.iter().sum::<f32>(), totals.iter().sum::<f32>());
                out[x] = if total > 0.0 { sum / total } else { 0.0 };
            }
        }
        Ok(())
    }
}

/// The values of a row at four columns, which are neighbours but at its ends.
fn values(row: &[f32], at: &[usize; TAPS]) -> [f32; TAPS] {
    match row.get(at[0]..).and_then(|row| row.first_chunk()) {
        Some(values) if at[TAPS - 1] == at[0] + TAPS - 1 => *values,
        _ => at.map(|column| row[column]),
    }
}

fn taps(at: usize, small: usize, large: usize) -> Taps {
    let place = (at as f64 + 0.5) * small as f64 / large as f64 - 0.5;
    let first = place.floor() as i64 - 1;
    let index = |k: usize| (first + k as i64).clamp(0, small as i64 - 1) as usize;
    let weight = |k: usize| (-0.5 * ((first + k as i64) as f64 - place).powi(2) / (NEAR * NEAR)).exp() as f32;
    (std::array::from_fn(index), std::array::from_fn(weight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Means of values: they stay within the map's range, and a constant stays constant whatever the guides.
        #[test]
        fn values_stay_within_the_range_of_the_map(rows in 1..9_usize, columns in 1..9_usize, height in 1..30_usize, width in 1..30_usize, seed: u32) {
            let noise = |y: usize, x: usize| ((seed as usize).wrapping_add(y * 7919 + x * 104_729).wrapping_mul(2_654_435_761) >> 9) as u8 as f32 / 255.0;
            let small = [Array2::from_shape_fn((rows, columns), |(y, x)| noise(y, x))];
            let large = [Array2::from_shape_fn((height, width), |(y, x)| noise(y + 5, x))];
            let map = Array2::from_shape_fn((rows, columns), |(y, x)| 1.0 + noise(x, y));
            let constant = Array2::from_elem((rows, columns), 3.0_f32);
            let upsampling = JointUpsampling::new(&small, &large, 0.1)?;
            for y in 0..height {
                let (mut varied, mut flat) = (vec![0.0; width], vec![0.0; width]);
                upsampling.row(&[map.view(), constant.view()], y, &mut [&mut varied, &mut flat])?;
                prop_assert!(varied.iter().all(|v| (0.999..=2.001).contains(v)));
                prop_assert!(flat.iter().all(|v| (v - 3.0).abs() < 1e-5));
            }
        }
    }

    #[test]
    fn missing_values_have_no_weight_and_an_empty_map_stays_empty() {
        let (small, large) = ([Array2::zeros((2, 2))], [Array2::zeros((1, 5))]);
        let upsampling = JointUpsampling::new(&small, &large, 0.1).unwrap();
        let map = ndarray::array![[0.0_f32, 2.0], [f32::INFINITY, 0.0]];
        let (mut one, mut none) = ([9.0; 5], [9.0; 5]);
        upsampling.row(&[map.view(), small[0].view()], 0, &mut [&mut one, &mut none]).unwrap();
        assert_eq!((one, none), ([2.0; 5], [0.0; 5]));
        assert!(upsampling.row(&[large[0].view()], 0, &mut [&mut one]).is_err());
    }
}
