use crate::scalar::Scalar;

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

    /// Features of `points` (in the unit cube), one row of `stride` each, padded with zeros.
    pub(crate) fn forward<T: Scalar>(self, points: &[[T; 3]], features: &mut Vec<T>, stride: usize) {
        features.clear();
        features.resize(points.len() * stride, T::ZERO);
        let two = T::ONE + T::ONE;
        for (point, row) in points.iter().zip(features.chunks_exact_mut(stride)) {
            for (axis, &q) in point.iter().enumerate() {
                let q = two * q - T::ONE;
                row[axis] = q;
                let (mut sin, mut cos) = (q * T::from_f64(std::f64::consts::PI)).sin_cos();
                for k in 0..self.frequencies {
                    row[3 + 6 * k + axis] = sin;
                    row[6 + 6 * k + axis] = cos;
                    // The next octave by the double angle.
                    (sin, cos) = (two * sin * cos, T::ONE - two * sin * sin);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octaves_are_sines_and_cosines_of_the_doubled_angle() {
        let encoding = Frequency { frequencies: 10 };
        let point = [0.3_f32, 0.81, 0.5];
        let mut features = Vec::new();
        encoding.forward(&[point], &mut features, 64);
        for k in 0..10 {
            for (axis, &q) in point.iter().enumerate() {
                let angle = f64::from(1_u32 << k) * std::f64::consts::PI * (2.0 * f64::from(q) - 1.0);
                assert!((f64::from(features[3 + 6 * k + axis]) - angle.sin()).abs() < 2e-4);
                assert!((f64::from(features[6 + 6 * k + axis]) - angle.cos()).abs() < 2e-4);
            }
        }
        assert_eq!(features[63], 0.0);
        assert_eq!(encoding.width(), 63);
    }
}
