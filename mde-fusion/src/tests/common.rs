//! Helpers shared by the tests.
use crate::{GaussianDepth, Prior};
use ndarray::Array2;

/// Applies `f` to every pixel that is not missing.
pub(crate) fn map(view: &GaussianDepth, f: impl Fn(f64, f64) -> (f64, f64)) -> GaussianDepth {
    view.clone().map(|m, v| {
        let (m, v) = f(m.into(), v.into());
        (m as f32, v as f32)
    })
}

/// Applies `f` to every depth that is not missing.
pub(crate) fn map_prior(prior: &Prior, f: impl Fn(f64) -> f64) -> Prior {
    Prior::new(prior.mean().mapv(|d| if d > 0.0 { f(d.into()) as f32 } else { 0.0 })).unwrap()
}

/// Largest relative difference of two maps; infinite where one alone misses a pixel.
pub(crate) fn difference(a: &GaussianDepth, b: &GaussianDepth) -> f64 {
    assert_eq!(a.dim(), b.dim());
    let worst = |x: &Array2<f64>, y: &Array2<f64>| {
        let pairs = x.iter().zip(y);
        pairs
            .map(|(x, y)| if x == y { 0.0 } else { (x - y).abs() / x.abs().max(y.abs()) })
            .fold(0.0, f64::max)
    };
    let f64s = |m: ndarray::ArrayView2<'_, f32>| m.mapv(f64::from);
    worst(&f64s(a.mean()), &f64s(b.mean())).max(worst(&f64s(a.variance()), &f64s(b.variance())))
}

/// SplitMix64 (Steele, Lea, Flood 2014), and standard normals from it by Box and Muller.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}
