//! Small matrix products over tiles of points.
//!
//! Matrices are row-major, one row a point, and every width is a multiple of [`LANES`] (narrower layers are padded with
//! zeros). The `f32` products keep a block of the result in registers for whatever vector width the processor has
//! (chosen at run time); the plain loops for any scalar are the reference.

use mde_uncertainty::Real;
use pulp::{Simd, WithSimd};

/// Widths are padded to a multiple of this: one AVX-512 register of `f32`.
pub(crate) const LANES: usize = 16;

/// The smallest padded width that holds `n` columns.
pub(crate) const fn padded(n: usize) -> usize {
    n.div_ceil(LANES) * LANES
}

/// The sizes of a product: `x` is `[points, inputs]`, `w` is `[inputs, outputs]`, `y` is `[points, outputs]`.
#[derive(Clone, Copy)]
pub(crate) struct Shape {
    /// Padded width of `x`.
    pub(crate) inputs: usize,
    /// Columns of `x` that are not padding.
    pub(crate) used: usize,
    /// Padded width of `y`.
    pub(crate) outputs: usize,
}

/// Operations on a product: adds a bias, and clamps at zero for a ReLU.
#[derive(Clone, Copy)]
pub(crate) struct Epilogue<'a, T> {
    pub(crate) bias: Option<&'a [T]>,
    pub(crate) relu: bool,
}

/// `y = x w`, then the epilogue.
pub(crate) struct Product<'a> {
    pub(crate) x: &'a [f32],
    pub(crate) w: &'a [f32],
    pub(crate) y: &'a mut [f32],
    pub(crate) shape: Shape,
    pub(crate) epilogue: Epilogue<'a, f32>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let vectors = self.shape.outputs / S::F32_LANES;
        // 12 to 24 accumulators hide the latency of two multiply-add pipes and stay in registers.
        match (S::F32_LANES, vectors) {
            (16, v) if v % 4 == 0 => self.panels::<S, 6, 4>(simd),
            (16, v) if v % 2 == 0 => self.panels::<S, 10, 2>(simd),
            (16, _) => self.panels::<S, 12, 1>(simd),
            (_, v) if v % 2 == 0 => self.panels::<S, 5, 2>(simd),
            _ => self.panels::<S, 8, 1>(simd),
        }
    }
}

impl Product<'_> {
    /// All rows, `ROWS` at a time, then the rest one by one.
    #[inline(always)]
    fn panels<S: Simd, const ROWS: usize, const VECTORS: usize>(self, simd: S) {
        let Self { x, w, y, shape, epilogue } = self;
        let (k, m) = (shape.inputs, shape.outputs);
        let (w, _) = S::as_simd_f32s(w);
        let bias = epilogue.bias.map(|b| S::as_simd_f32s(b).0);
        let mut x_blocks = x.chunks_exact(ROWS * k);
        let mut y_blocks = y.chunks_exact_mut(ROWS * m);
        for (x, y) in (&mut x_blocks).zip(&mut y_blocks) {
            product_rows::<S, ROWS, VECTORS>(simd, x, w, y, shape, bias, epilogue.relu);
        }
        for (x, y) in x_blocks.remainder().chunks_exact(k).zip(y_blocks.into_remainder().chunks_exact_mut(m))
        {
            product_rows::<S, 1, VECTORS>(simd, x, w, y, shape, bias, epilogue.relu);
        }
    }
}

/// `ROWS` rows of the product, `VECTORS` registers of columns at a time.
#[inline(always)]
fn product_rows<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    x: &[f32],
    w: &[S::f32s],
    y: &mut [f32],
    shape: Shape,
    bias: Option<&[S::f32s]>,
    relu: bool,
) {
    let Shape { inputs: k, used, outputs: m } = shape;
    let width = m / S::F32_LANES;
    let zero = simd.splat_f32s(0.0);
    let rows: [&[f32]; ROWS] = std::array::from_fn(|r| &x[r * k..(r + 1) * k]);
    for column in (0..width).step_by(VECTORS) {
        let start: [S::f32s; VECTORS] = std::array::from_fn(|v| bias.map_or(zero, |b| b[column + v]));
        let mut sums = [start; ROWS];
        for (i, w) in w.chunks_exact(width).enumerate().take(used) {
            let w = &w[column..column + VECTORS];
            for r in 0..ROWS {
                let x = simd.splat_f32s(rows[r][i]);
                for v in 0..VECTORS {
                    sums[r][v] = simd.mul_add_f32s(x, w[v], sums[r][v]);
                }
            }
        }
        // By number, so that the sums stay in registers.
        for r in 0..ROWS {
            let (y, _) = S::as_mut_simd_f32s(&mut y[r * m..(r + 1) * m]);
            for v in 0..VECTORS {
                y[column + v] = if relu { simd.max_f32s(sums[r][v], zero) } else { sums[r][v] };
            }
        }
    }
}

/// Rows of an outer product per panel, so that the columns of `dy` stay in the first-level cache.
const PANEL_ROWS: usize = 128;

/// `dw += x^T dy`.
pub(crate) struct Outer<'a> {
    pub(crate) x: &'a [f32],
    pub(crate) dy: &'a [f32],
    pub(crate) dw: &'a mut [f32],
    pub(crate) shape: Shape,
}

impl WithSimd for Outer<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let vectors = self.shape.outputs / S::F32_LANES;
        match (S::F32_LANES, vectors) {
            (16, v) if v % 4 == 0 => self.blocks::<S, 4, 4>(simd),
            (16, v) if v % 2 == 0 => self.blocks::<S, 8, 2>(simd),
            (16, _) => self.blocks::<S, 16, 1>(simd),
            (_, v) if v % 2 == 0 => self.blocks::<S, 4, 2>(simd),
            _ => self.blocks::<S, 8, 1>(simd),
        }
    }
}

impl Outer<'_> {
    /// Blocks of `INPUTS` rows by `VECTORS` registers of the weight gradient; `k` is a multiple of [`LANES`], so of `INPUTS`.
    #[inline(always)]
    fn blocks<S: Simd, const INPUTS: usize, const VECTORS: usize>(self, simd: S) {
        let Self { x, dy, dw, shape } = self;
        let (k, m) = (shape.inputs, shape.outputs);
        let width = m / S::F32_LANES;
        let (dy, _) = S::as_simd_f32s(dy);
        let (dw, _) = S::as_mut_simd_f32s(dw);
        for (x, dy) in x.chunks(PANEL_ROWS * k).zip(dy.chunks(PANEL_ROWS * width)) {
            for column in (0..width).step_by(VECTORS) {
                for input in (0..shape.used).step_by(INPUTS) {
                    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; INPUTS];
                    for (x, dy) in x.chunks_exact(k).zip(dy.chunks_exact(width)) {
                        let x = &x[input..input + INPUTS];
                        let dy = &dy[column..column + VECTORS];
                        for i in 0..INPUTS {
                            let x = simd.splat_f32s(x[i]);
                            for v in 0..VECTORS {
                                sums[i][v] = simd.mul_add_f32s(x, dy[v], sums[i][v]);
                            }
                        }
                    }
                    for (i, sums) in sums.iter().enumerate() {
                        for (v, &sum) in sums.iter().enumerate() {
                            let slot = &mut dw[(input + i) * width + column + v];
                            *slot = simd.add_f32s(*slot, sum);
                        }
                    }
                }
            }
        }
    }
}

/// The reference of [`Product`], for any scalar.
pub(crate) fn matmul_plain<T: Real>(x: &[T], w: &[T], y: &mut [T], shape: Shape, epilogue: Epilogue<'_, T>) {
    let (k, m) = (shape.inputs, shape.outputs);
    for (x, y) in x.chunks_exact(k).zip(y.chunks_exact_mut(m)) {
        for (column, y) in y.iter_mut().enumerate() {
            let product: T = x.iter().take(shape.used).enumerate().map(|(i, &x)| x * w[i * m + column]).sum();
            let sum = product + epilogue.bias.map_or(T::ZERO, |b| b[column]);
            *y = if epilogue.relu { sum.max(T::ZERO) } else { sum };
        }
    }
}

/// The reference of [`Outer`], for any scalar.
pub(crate) fn outer_plain<T: Real>(x: &[T], dy: &[T], dw: &mut [T], shape: Shape) {
    let (k, m) = (shape.inputs, shape.outputs);
    for (x, dy) in x.chunks_exact(k).zip(dy.chunks_exact(m)) {
        for (i, &x) in x.iter().enumerate().take(shape.used) {
            for (column, &dy) in dy.iter().enumerate() {
                dw[i * m + column] += x * dy;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scalar::Scalar;
    use mde_uncertainty::random::CounterRng;
    use proptest::prelude::*;
    use rand::RngExt;

    fn noise(seed: u64, n: usize) -> Vec<f32> {
        let mut rng = CounterRng::new(seed, "gemm-test", 0, 0);
        (0..n).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    fn wide(v: &[f32]) -> Vec<f64> {
        v.iter().map(|&x| f64::from(x)).collect()
    }

    fn close(fast: &[f32], exact: &[f64], terms: usize) -> bool {
        // Rounding of a sum of `terms` products of numbers below 1/2.
        let bound = 4.0 * f64::from(f32::EPSILON) * (terms as f64 + 8.0) * 0.25;
        fast.iter().zip(exact).all(|(f, e)| (f64::from(*f) - e).abs() <= bound)
    }

    proptest! {
        #[test]
        fn fast_products_agree_with_the_reference(seed: u64, n in 0..40_usize, used in 1..90_usize, m in 1..10_usize, relu: bool) {
            let (k, m) = (padded(used), m * LANES);
            let shape = Shape { inputs: k, used, outputs: m };
            let (mut x, w, dy, bias) = (noise(seed, n * k), noise(seed ^ 1, k * m), noise(seed ^ 2, n * m), noise(seed ^ 3, m));
            x.chunks_exact_mut(k).for_each(|row| row[used..].fill(0.0));
            let (mut y, mut exact) = (vec![0.0; n * m], vec![0.0; n * m]);
            f32::matmul(&x, &w, &mut y, shape, Epilogue { bias: Some(&bias), relu });
            matmul_plain(&wide(&x), &wide(&w), &mut exact, shape, Epilogue { bias: Some(&wide(&bias)), relu });
            prop_assert!(close(&y, &exact, k));

            let (mut dw, mut exact) = (noise(seed ^ 4, k * m), vec![]);
            exact.extend(wide(&dw));
            f32::outer(&x, &dy, &mut dw, shape);
            outer_plain(&wide(&x), &wide(&dy), &mut exact, shape);
            prop_assert!(close(&dw, &exact, n));
        }
    }

    /// Every sum is of the same terms in the same order, each rounded once.
    #[test]
    #[cfg(target_arch = "x86_64")]
    fn products_are_the_same_bytes_for_any_vector_width() {
        use pulp::Scalar;
        use pulp::x86::{V3, V4};
        fn products<S: Simd>(simd: S, m: usize) -> Vec<u32> {
            let (n, used, m) = (37, 21, m * LANES);
            let k = padded(used);
            let shape = Shape { inputs: k, used, outputs: m };
            let (mut x, w, dy, bias) = (noise(0, n * k), noise(1, k * m), noise(2, n * m), noise(3, m));
            x.chunks_exact_mut(k).for_each(|row| row[used..].fill(0.0));
            let (mut y, mut dw) = (vec![0.0; n * m], noise(4, k * m));
            let epilogue = Epilogue { bias: Some(&bias), relu: true };
            simd.vectorize(Product { x: &x, w: &w, y: &mut y, shape, epilogue });
            simd.vectorize(Outer { x: &x, dy: &dy, dw: &mut dw, shape });
            y.iter().chain(&dw).map(|v| v.to_bits()).collect()
        }
        for m in 1..9 {
            let plain = products(Scalar::new(), m);
            assert!(plain.iter().any(|bits| *bits != 0));
            if let Some(simd) = V3::try_new() {
                assert_eq!(products(simd, m), plain, "AVX2, {m}");
            }
            if let Some(simd) = V4::try_new() {
                assert_eq!(products(simd, m), plain, "AVX-512, {m}");
            }
        }
    }
}
