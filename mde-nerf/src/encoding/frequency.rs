use crate::points::{BLOCK, Points};
use crate::scalar::{Scalar, vectorized};

/// The frequency encoding of Mildenhall et al. (2020):
/// \\(\gamma(q) = (q, \sin 2^k \pi q, \cos 2^k \pi q)_{k < K}\\), with \\(q\\) scaled to \\([-1, 1]\\).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Frequency {
    pub(crate) frequencies: usize,
}

impl Frequency {
    /// Number of features.
    pub(crate) fn width(self) -> usize {
        3 + 6 * self.frequencies
    }

    /// Features of `points`, one row of `stride` each; other columns are not written.
    pub(crate) fn forward<T: Scalar>(self, points: &Points<T>, features: &mut [T], stride: usize) {
        vectorized!(T, || {
            for (block, rows) in points.blocks().zip(features.chunks_exact_mut(BLOCK * stride)) {
                for (axis, q) in block.into_iter().enumerate() {
                    let mut angle = q.map(|q| (T::ONE + T::ONE) * q - T::ONE);
                    put(rows, stride, axis, angle);
                    for k in 0..self.frequencies {
                        put(rows, stride, 3 + 6 * k + axis, angle.map(T::sin_pi));
                        put(rows, stride, 6 + 6 * k + axis, angle.map(T::cos_pi));
                        // Doubling a float is exact, so every octave is as exact as the first.
                        angle = angle.map(|a| a + a);
                    }
                }
            }
        });
    }
}

#[inline(always)]
fn put<T: Copy>(rows: &mut [T], stride: usize, column: usize, values: [T; BLOCK]) {
    for (row, value) in rows.chunks_exact_mut(stride).zip(values) {
        row[column] = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octaves_are_sines_and_cosines_of_the_doubled_angle() {
        let encoding = Frequency { frequencies: 10 };
        let point = [0.3_f32, 0.81, 0.5];
        let mut points = Points::default();
        points.push(point);
        points.pad();
        let mut features = vec![0.0; BLOCK * 64];
        encoding.forward(&points, &mut features, 64);
        for k in 0..10 {
            for (axis, &q) in point.iter().enumerate() {
                let angle = f64::from(1_u32 << k) * std::f64::consts::PI * f64::from(2.0 * q - 1.0);
                assert!((f64::from(features[3 + 6 * k + axis]) - angle.sin()).abs() < 1e-6);
                assert!((f64::from(features[6 + 6 * k + axis]) - angle.cos()).abs() < 1e-6);
            }
        }
        assert_eq!(features[63], 0.0);
        assert_eq!(encoding.width(), 63);
    }
}
