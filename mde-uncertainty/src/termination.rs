//! Where a ray ends: opacity, transmittance, termination weights and their moments (Eq. 2-5).
//!
//! A ray is cut into bins \\(i = 1 \dots M\\) with representative depth \\(t_i\\), extent \\(\Delta_i\\) and density
//! \\(\sigma_i\\). Everything here is generic over [`Real`], so that the `f64` version is the reference of the `f32` one.

use crate::Real;

/// The variance that the extent of a bin adds.
///
/// Eq. 5 puts the mass of a bin at its midpoint, so that a surface inside one bin has a variance of 0, and the clamp determines its weight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum InBinVariance {
    /// Nothing: Eq. 5 as printed.
    #[default]
    Midpoint,
    /// \\(\Delta_i^2 / 12\\): the ray ends anywhere in the bin with equal probability.
    Uniform,
}

/// Moments of the termination depth of a ray.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moments<T> {
    /// \\(A = \sum_i w_i\\): the probability that the ray ends.
    pub opacity: T,
    /// \\(\mu_r\\), Eq. 4; 0 where the opacity is 0.
    pub mean: T,
    /// \\(\sigma_r^2\\), Eq. 5; 0 where the opacity is 0.
    pub variance: T,
    /// The part of it that [`InBinVariance`] adds.
    pub in_bin: T,
}

/// Opacity of one bin (Eq. 2, left): \\(\alpha_i = 1 - e^{-\sigma_i \Delta_i}\\), exact for thin bins.
#[inline(always)]
pub fn alpha<T: Real>(density: T, extent: T) -> T {
    -(-(density * extent)).exp_m1()
}

/// Termination weights (Eq. 2-3): \\(w_i = T_i \alpha_i\\), \\(T_i = \prod_{j<i}(1 - \alpha_j)\\).
///
/// `density`, `extent` and `weights` have one entry per bin (the shortest counts); `extent` is the length of the bin along
/// the ray. Returns the transmittance behind the last bin, so that the weights and it add up to 1.
#[inline(always)]
pub fn weights<T: Real>(density: &[T], extent: &[T], weights: &mut [T]) -> T {
    let mut transmittance = T::ONE;
    for ((&s, &d), w) in density.iter().zip(extent).zip(weights) {
        let a = alpha(s, d);
        *w = transmittance * a;
        transmittance = transmittance * (T::ONE - a);
    }
    transmittance
}

/// Mean and variance of the termination depth (Eq. 3-5), given that the ray ends.
///
/// \\[ p_i = \frac{w_i}{\sum_k w_k},\qquad \mu_r = \sum_i p_i t_i,\qquad \sigma_r^2 = \sum_i p_i (t_i - \mu_r)^2 \\]
///
/// The variance is Eq. 5 written about the mean, which is the same number without cancellation: \\(m_2 - \mu_r^2\\) has no digits left in
/// `f32` at 5 m and 1 mm. `depth` is the bins' representative depth, `extent` their size in the same unit, whose
/// values count only with [`InBinVariance::Uniform`]; all three have one entry per bin (the shortest counts) in either case.
#[inline(always)]
pub fn moments<T: Real>(weights: &[T], depth: &[T], extent: &[T], in_bin: InBinVariance) -> Moments<T> {
    let opacity: T = weights.iter().copied().sum();
    if opacity <= T::ZERO {
        return Moments::default();
    }
    // Sums are taken about the first depth: t - t_0 keeps the low bits that t itself would lose.
    let origin = depth.first().copied().unwrap_or_default();
    let mut mean = T::ZERO;
    for (w, offset, _) in bins(weights, depth, extent, origin, in_bin) {
        mean += w * offset;
    }
    mean = mean / opacity;
    let (mut variance, mut within) = (T::ZERO, T::ZERO);
    for (w, offset, inside) in bins(weights, depth, extent, origin, in_bin) {
        variance += w * ((offset - mean) * (offset - mean) + inside);
        within += w * inside;
    }
    Moments { opacity, mean: origin + mean, variance: variance / opacity, in_bin: within / opacity }
}

/// Each bin's weight, its mean depth less `origin`, and the variance inside it.
#[inline(always)]
fn bins<'a, T: Real>(
    weights: &'a [T],
    depth: &'a [T],
    extent: &'a [T],
    origin: T,
    in_bin: InBinVariance,
) -> impl Iterator<Item = (T, T, T)> + 'a {
    let twelfth = T::from_f64(1.0 / 12.0);
    weights.iter().zip(depth).zip(extent).map(move |((&w, &t), &d)| match in_bin {
        InBinVariance::Midpoint => (w, t - origin, T::ZERO),
        InBinVariance::Uniform => (w, t - origin, d * d * twelfth),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proptest::ray;
    use ::proptest::prelude::*;

    proptest! {
        /// Weights and transmittance add up to one; the moments are those of the printed equations, the mean lies on the ray, and the
        /// bins' extent only adds variance.
        #[test]
        fn moments_are_those_of_the_printed_equations((density, depth, extent) in ray()) {
            let mut w = vec![0.0; density.len()];
            let escaped = weights(&density, &extent, &mut w);
            let total: f64 = w.iter().sum();
            prop_assert!(w.iter().all(|&w| w >= 0.0) && (total + escaped - 1.0).abs() < 1e-12);
            prop_assume!(total > 1e-6);
            let mean = w.iter().zip(&depth).map(|(w, t)| w / total * t).sum::<f64>();
            let second = w.iter().zip(&depth).map(|(w, t)| w / total * t * t).sum::<f64>();
            let [midpoint, uniform] = [InBinVariance::Midpoint, InBinVariance::Uniform].map(|rule| moments(&w, &depth, &extent, rule));
            prop_assert!((midpoint.mean - mean).abs() < 1e-10);
            prop_assert!((midpoint.variance - (second - mean * mean)).abs() < 1e-9);
            prop_assert!(mean >= depth[0] - 1e-12 && mean <= depth[depth.len() - 1] + 1e-12);
            let sum = midpoint.variance + uniform.in_bin;
            prop_assert!(uniform.mean == midpoint.mean && midpoint.in_bin == 0.0 && uniform.in_bin > 0.0);
            prop_assert!((uniform.variance - sum).abs() < 1e-12 * sum);
        }

        /// Shifting a ray by 1 km must not touch its variance, in `f32` either.
        #[test]
        fn variance_is_shift_invariant_in_f32((density, depth, extent) in ray()) {
            let mut w = vec![0.0_f32; density.len()];
            let to = |v: &[f64], by: f64| v.iter().map(|x| (((x * 1024.0).round() + by) / 1024.0) as f32).collect::<Vec<_>>();
            weights(&to(&density, 0.0), &to(&extent, 0.0), &mut w);
            prop_assume!(w.iter().sum::<f32>() > 1e-6);
            let near = moments(&w, &to(&depth, 0.0), &to(&extent, 0.0), InBinVariance::Midpoint);
            let far = moments(&w, &to(&depth, 1024.0 * 1000.0), &to(&extent, 0.0), InBinVariance::Midpoint);
            prop_assert!((near.variance - far.variance).abs() <= 1e-6 + 1e-5 * near.variance);
        }
    }

    #[test]
    fn an_empty_ray_has_no_opacity() {
        let mut w = [1.0_f32; 4];
        assert_eq!(weights(&[0.0; 4], &[1.0; 4], &mut w), 1.0);
        assert_eq!(moments(&w, &[1.0, 2.0, 3.0, 4.0], &[1.0; 4], InBinVariance::Uniform), Moments::default());
        assert_eq!(moments::<f32>(&[], &[], &[], InBinVariance::Uniform), Moments::default());
    }
}
