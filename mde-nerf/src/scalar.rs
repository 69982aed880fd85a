use crate::gemm::{self, Epilogue};
use mde_uncertainty::Real;

/// What the field computes in: `f32` with vector kernels, `f64` with plain loops as the reference that gradients are
/// checked against.
pub(crate) trait Scalar: Real {
    /// `y[n, m] = x[n, k] w[k, m]`, then the epilogue; `k` and `m` are padded widths.
    fn matmul(x: &[Self], w: &[Self], y: &mut [Self], k: usize, m: usize, epilogue: Epilogue<'_, Self>);
    /// `dw[k, m] += x[n, k]^T dy[n, m]`.
    fn outer(x: &[Self], dy: &[Self], dw: &mut [Self], k: usize, m: usize);
    /// \\(e^x\\), to about 2 units in the last place; saturates instead of overflowing.
    fn fast_exp(self) -> Self;
    /// \\((\sin x, \cos x)\\).
    fn sin_cos(self) -> (Self, Self);
    /// Truncation towards zero, for non-negative numbers below 2^31.
    fn to_index(self) -> u32;
    /// An index as a scalar.
    fn from_index(index: u32) -> Self;
    /// Runs `op` compiled for the processor's widest vectors where that pays.
    fn vectorized<R>(op: impl FnOnce() -> R) -> R;

    /// \\(1 / (1 + e^{-x})\\).
    #[inline(always)]
    fn sigmoid(self) -> Self {
        Self::ONE / (Self::ONE + (-self).fast_exp())
    }
}

impl Scalar for f32 {
    fn matmul(x: &[f32], w: &[f32], y: &mut [f32], k: usize, m: usize, epilogue: Epilogue<'_, f32>) {
        gemm::matmul_f32(x, w, y, k, m, epilogue);
    }

    fn outer(x: &[f32], dy: &[f32], dw: &mut [f32], k: usize, m: usize) {
        gemm::outer_f32(x, dy, dw, k, m);
    }

    /// Cephes' polynomial on \\([-\ln 2 / 2, \ln 2 / 2]\\), without a branch so that loops over it vectorise.
    #[inline(always)]
    fn fast_exp(self) -> f32 {
        const HIGH: f32 = 0.693_359_4;
        const LOW: f32 = -2.121_944_4e-4;
        // Adding 1.5 * 2^23 rounds to the nearest integer.
        const ROUND: f32 = 12_582_912.0;
        let x = self.clamp(-87.0, 88.0);
        let n = (x * std::f32::consts::LOG2_E + ROUND) - ROUND;
        let r = (x - n * HIGH) - n * LOW;
        let mut p = 1.987_569_1e-4_f32;
        for c in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5_f32] {
            p = p * r + c;
        }
        let p = p * (r * r) + r + 1.0;
        p * f32::from_bits(((n as i32 + 127) as u32) << 23)
    }

    #[inline(always)]
    fn sin_cos(self) -> (f32, f32) {
        f32::sin_cos(self)
    }

    #[inline(always)]
    fn to_index(self) -> u32 {
        self as u32
    }

    #[inline(always)]
    fn from_index(index: u32) -> f32 {
        index as f32
    }

    #[inline(always)]
    fn vectorized<R>(op: impl FnOnce() -> R) -> R {
        pulp::Arch::new().dispatch(op)
    }
}

impl Scalar for f64 {
    fn matmul(x: &[f64], w: &[f64], y: &mut [f64], k: usize, m: usize, epilogue: Epilogue<'_, f64>) {
        gemm::matmul_f64(x, w, y, k, m, epilogue);
    }

    fn outer(x: &[f64], dy: &[f64], dw: &mut [f64], k: usize, m: usize) {
        gemm::outer_f64(x, dy, dw, k, m);
    }

    fn fast_exp(self) -> f64 {
        self.exp()
    }

    fn sin_cos(self) -> (f64, f64) {
        f64::sin_cos(self)
    }

    fn to_index(self) -> u32 {
        self as u32
    }

    fn from_index(index: u32) -> f64 {
        f64::from(index)
    }

    fn vectorized<R>(op: impl FnOnce() -> R) -> R {
        op()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_exponential_is_exact_to_two_units_in_the_last_place() {
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
