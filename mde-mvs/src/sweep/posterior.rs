//! From aggregated costs to a multiple of the centre with its variance.

use pulp::{Simd, WithSimd};

/// Estimate from the costs of one pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Estimate {
    /// Index of the surface, with a fraction.
    pub(crate) surface: f32,
    /// Variance about it within its own valley, in surfaces squared.
    pub(crate) variance: f32,
    /// Share of the posterior in that valley.
    pub(crate) mass: f32,
}

/// Surfaces whose weights are computed together.
const LANES: usize = 16;

/// \\( e^{-x} \\) for x >= 0 to 5e-6 of its value, 0 from 16 on; without a branch, so that it vectorises.
#[inline(always)]
fn decay(x: f32) -> f32 {
    // 2^(n - f) with a whole n and f from 0 to 1.
    let doublings = -x * std::f32::consts::LOG2_E;
    let whole = doublings.floor();
    let f = (doublings - whole) * std::f32::consts::LN_2;
    // Taylor's series about the middle of the interval, to the sixth power.
    let t = f - 0.5 * std::f32::consts::LN_2;
    let series = 1.0 + t * (1.0 + t * (0.5 + t * (1.0 / 6.0 + t * (1.0 / 24.0 + t * (1.0 / 120.0)))));
    // 2^23 + 127 + n, whose lowest bits are the exponent of 2^n.
    let exponent = (whole.max(-126.0) + (8_388_608.0 + 127.0)).to_bits() << 23;
    let value = std::f32::consts::SQRT_2 * series * f32::from_bits(exponent);
    if x < 16.0 { value } else { 0.0 }
}

/// The lowest cost, its fraction by a parabola through its neighbours, and the softmin about it.
///
/// The valley of the lowest cost reaches to either side until the costs begin to fall again for good: to the first
/// surface from which the weight rises above twice the least weight so far. `weights` has a place for each surface.
#[inline(always)]
pub(crate) fn estimate(costs: &[u16], temperature: f32, weights: &mut [f32]) -> Estimate {
    let lowest = costs.iter().fold(u16::MAX, |least, &c| least.min(c));
    let best = costs.iter().position(|&c| c == lowest).unwrap_or(0);
    let per_cost = temperature.recip();
    let weights = &mut weights[..costs.len()];
    for (weight, &cost) in weights.iter_mut().zip(costs) {
        *weight = decay(f32::from(cost - lowest) * per_cost);
    }
    let mut totals = [0.0_f32; LANES];
    let (chunks, rest) = weights.as_chunks::<LANES>();
    for chunk in chunks {
        for (total, weight) in totals.iter_mut().zip(chunk) {
            *total += weight;
        }
    }
    let total: f32 = totals.iter().sum::<f32>() + rest.iter().sum::<f32>();
    let fraction = if best > 0 && best + 1 < costs.len() {
        let (a, b, c) = (f32::from(costs[best - 1]), f32::from(costs[best]), f32::from(costs[best + 1]));
        let curvature = a - 2.0 * b + c;
        if curvature > 0.0 { 0.5 * (a - c) / curvature } else { 0.0 }
    } else {
        0.0
    };
    let surface = best as f32 + fraction;
    let (mut mass, mut spread) = (1.0_f32, fraction * fraction);
    let mut side = |surfaces: &mut dyn Iterator<Item = usize>| {
        let mut least = 1.0_f32;
        for k in surfaces {
            let w = weights[k];
            if w > 2.0 * least || w == 0.0 {
                break;
            }
            least = least.min(w);
            mass += w;
            spread += w * (k as f32 - surface).powi(2);
        }
    };
    side(&mut (0..best).rev());
    side(&mut (best + 1..costs.len()));
    // A surface stands for all depths up to half way to its neighbours.
    Estimate { surface, variance: spread / mass + 1.0 / 12.0, mass: (mass / total).min(1.0) }
}

/// [`estimate`] of each pixel of a row of costs `[pixel, surface]`.
pub(crate) struct EstimateRow<'a> {
    pub(crate) costs: &'a [u16],
    pub(crate) surfaces: usize,
    pub(crate) temperature: f32,
    pub(crate) weights: &'a mut [f32],
    pub(crate) found: &'a mut [Estimate],
}

impl WithSimd for EstimateRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { costs, surfaces, temperature, weights, found } = self;
        for (costs, found) in costs.chunks_exact(surfaces).zip(found) {
            *found = estimate(costs, temperature, weights);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decay_is_the_exponential(x in 0.0..15.99_f32) {
            let exact = (-f64::from(x)).exp();
            prop_assert!((f64::from(decay(x)) / exact - 1.0).abs() < 5e-6, "{}", decay(x));
        }

        /// A parabola's minimum is found, wherever it lies between surfaces.
        #[test]
        fn a_valley_is_found_between_surfaces(at in 3.0..28.0_f32, depth in 4.0..40.0_f32) {
            let costs: Vec<u16> = (0..32).map(|k| (100.0 + depth * (k as f32 - at).powi(2)).round() as u16).collect();
            let found = estimate(&costs, 20.0, &mut [0.0; 32]);
            prop_assert!((found.surface - at).abs() < 0.15);
            prop_assert!(found.mass > 0.99);
        }

        /// Two equal valleys share the mass.
        #[test]
        fn two_valleys_are_ambiguous(a in 3..10_usize, gap in 8..15_usize) {
            let valley = |k: usize, at: usize| 40 * k.abs_diff(at).pow(2).min(20) as u16;
            let costs: Vec<u16> = (0..32).map(|k| valley(k, a).min(valley(k, a + gap))).collect();
            let found = estimate(&costs, 20.0, &mut [0.0; 32]);
            prop_assert!((found.mass - 0.5).abs() < 0.05, "{:?}", found);
        }
    }
}
