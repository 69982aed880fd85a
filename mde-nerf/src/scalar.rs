use crate::gemm::{Epilogue, Outer, Product, Shape, matmul_plain, outer_plain};
use mde_uncertainty::Real;
use pulp::Arch;

/// Scalar type of the field: `f32` with vector kernels for fitting, `f64` with plain loops as the reference, and in tests a
/// dual number whose derivatives are exact.
pub(crate) trait Scalar: Real {
    /// `y = x w`, then the epilogue.
    fn matmul(x: &[Self], w: &[Self], y: &mut [Self], shape: Shape, epilogue: Epilogue<'_, Self>) {
        matmul_plain(x, w, y, shape, epilogue);
    }
    /// `dw += x^T dy`.
    fn outer(x: &[Self], dy: &[Self], dw: &mut [Self], shape: Shape) {
        outer_plain(x, dy, dw, shape);
    }
    /// \\(e^x\\), to about 2 units in the last place; saturates instead of overflowing.
    fn fast_exp(self) -> Self {
        self.exp()
    }
    /// \\(\sin \pi x\\), for numbers below 2^20.
    fn sin_pi(self) -> Self;
    /// \\(\cos \pi x\\), for numbers below 2^20.
    fn cos_pi(self) -> Self;
    /// `self * a + b`, rounded once for `f32`.
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }
    /// The whole part of a number from 0 to 2^22; of a whole number it may be the one below.
    fn to_index(self) -> u32 {
        self.to_f64() as u32
    }
    /// An index as a scalar.
    #[inline(always)]
    fn from_index(index: u32) -> Self {
        Self::from_f64(f64::from(index))
    }
    /// Runs `op`, compiled for the processor's widest vectors for `f32`.
    fn vectorized<R>(op: impl FnOnce() -> R) -> R {
        op()
    }

    /// \\(1 / (1 + e^{-x})\\).
    #[inline(always)]
    fn sigmoid(self) -> Self {
        Self::ONE / (Self::ONE + (-self).fast_exp())
    }
}

/// Runs a closure by [`Scalar::vectorized`], inlined as it must be to be compiled for those vectors.
macro_rules! vectorized {
    ($scalar:ty, || $body:block) => {
        <$scalar>::vectorized(
            #[inline(always)]
            || $body,
        )
    };
}
pub(crate) use vectorized;

impl Scalar for f32 {
    fn matmul(x: &[f32], w: &[f32], y: &mut [f32], shape: Shape, epilogue: Epilogue<'_, f32>) {
        Arch::new().dispatch(Product { x, w, y, shape, epilogue });
    }

    fn outer(x: &[f32], dy: &[f32], dw: &mut [f32], shape: Shape) {
        Arch::new().dispatch(Outer { x, dy, dw, shape });
    }

    /// Cephes' polynomial on \\([-\ln 2 / 2, \ln 2 / 2]\\), without a branch so that loops over it vectorise.
    #[inline(always)]
    fn fast_exp(self) -> f32 {
        const HIGH: f32 = 0.693_359_4;
        const LOW: f32 = -2.121_944_4e-4;
        let x = self.clamp(-87.0, 88.0);
        let shifted = x * std::f32::consts::LOG2_E + ROUND;
        let n = shifted - ROUND;
        let r = (x - n * HIGH) - n * LOW;
        let mut p = 1.987_569_1e-4_f32;
        for c in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5_f32] {
            p = p * r + c;
        }
        let p = p * (r * r) + r + 1.0;
        p * f32::from_bits((shifted.to_bits() + 127) << 23)
    }

    /// Taylor's polynomial on \\([-1/2, 1/2]\\), to which whole turns reduce exactly.
    #[inline(always)]
    #[allow(clippy::excessive_precision, reason = "the digits of the series")]
    fn sin_pi(self) -> f32 {
        let (r, sign) = half_turns(self);
        let q = r * r;
        let mut p = -0.007_370_43_f32;
        for c in [0.082_145_885, -0.599_264_5, 2.550_164, -5.167_713, std::f32::consts::PI] {
            p = p * q + c;
        }
        f32::from_bits((p * r).to_bits() ^ sign)
    }

    #[inline(always)]
    #[allow(clippy::excessive_precision, reason = "the digits of the series")]
    fn cos_pi(self) -> f32 {
        let (r, sign) = half_turns(self);
        let q = r * r;
        let mut p = 0.001_929_574_3_f32;
        for c in [-0.025_806_89, 0.235_330_63, -1.335_262_8, 4.058_712, -4.934_802_2, 1.0] {
            p = p * q + c;
        }
        f32::from_bits(p.to_bits() ^ sign)
    }

    #[inline(always)]
    fn mul_add(self, a: f32, b: f32) -> f32 {
        f32::mul_add(self, a, b)
    }

    /// Rounds by adding [`ROUND`]: a cast, which saturates, is not vectorised.
    #[inline(always)]
    fn to_index(self) -> u32 {
        ((self - 0.5) + ROUND).to_bits() - ROUND.to_bits()
    }

    #[inline(always)]
    fn from_index(index: u32) -> f32 {
        index as f32
    }

    #[inline(always)]
    fn vectorized<R>(op: impl FnOnce() -> R) -> R {
        Arch::new().dispatch(op)
    }
}

impl Scalar for f64 {
    fn sin_pi(self) -> f64 {
        (self % 2.0 * std::f64::consts::PI).sin()
    }

    fn cos_pi(self) -> f64 {
        (self % 2.0 * std::f64::consts::PI).cos()
    }
}

/// Adding 1.5 * 2^23 rounds to the nearest integer.
const ROUND: f32 = 12_582_912.0;

/// The distance to the nearest integer, and the sign bit that an odd one flips.
#[inline(always)]
fn half_turns(x: f32) -> (f32, u32) {
    let shifted = x + ROUND;
    (x - (shifted - ROUND), shifted.to_bits() << 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_of_half_turns() {
        for i in -200_000..200_000 {
            let x = i as f32 * 0.005_13;
            let angle = (f64::from(x) % 2.0) * std::f64::consts::PI;
            assert!((f64::from(x.sin_pi()) - angle.sin()).abs() < 3e-7, "{x}");
            assert!((f64::from(x.cos_pi()) - angle.cos()).abs() < 3e-7, "{x}");
        }
    }

    #[test]
    fn the_fast_exponential_is_within_two_units_in_the_last_place() {
        let mut worst = 0.0_f64;
        for i in -870_000..880_000 {
            let x = i as f32 * 1e-4;
            let exact = f64::from(x).exp();
            worst = worst.max((f64::from(x.fast_exp()) - exact).abs() / exact);
        }
        assert!(worst < 2.0 * f64::from(f32::EPSILON), "relative error {worst:e}");
        assert!((-1e9_f32).fast_exp() >= 0.0 && 1e9_f32.fast_exp().is_finite());
    }
}
