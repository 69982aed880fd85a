//! From aggregated costs to a multiple of the centre with its variance.

/// Estimate from the costs of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    /// Index of the surface, with a fraction.
    pub(crate) surface: f32,
    /// Variance about it within its own valley, in surfaces squared.
    pub(crate) variance: f32,
    /// Share of the posterior in that valley.
    pub(crate) mass: f32,
}

/// Weights of cost differences, \\( e^{-i/T} \\) for i = 0, 1, 2, ... until they vanish.
pub(crate) fn softmin_table(temperature: f32) -> Vec<f32> {
    let last = (16.0 * temperature).ceil() as usize;
    (0..=last.max(1)).map(|i| (-(i as f32) / temperature).exp()).collect()
}

/// The lowest cost, its fraction by a parabola through its neighbours, and the softmin about it.
///
/// The valley of the lowest cost reaches to either side until the costs begin to fall again for good: to the first
/// surface from which the weight rises above twice the least weight so far.
pub(crate) fn estimate(costs: &[u16], table: &[f32]) -> Option<Estimate> {
    let (best, &lowest) = costs.iter().enumerate().min_by_key(|(_, c)| **c)?;
    let weight = |k: usize| table.get(usize::from(costs[k] - lowest)).copied().unwrap_or(0.0);
    let fraction = if best > 0 && best + 1 < costs.len() {
        let (a, b, c) = (f32::from(costs[best - 1]), f32::from(costs[best]), f32::from(costs[best + 1]));
        let curvature = a - 2.0 * b + c;
        if curvature > 0.0 { 0.5 * (a - c) / curvature } else { 0.0 }
    } else {
        0.0
    };
    let surface = best as f32 + fraction;
    let total: f32 = (0..costs.len()).map(weight).sum();
    let (mut mass, mut spread) = (1.0_f32, fraction * fraction);
    let mut side = |surfaces: &mut dyn Iterator<Item = usize>| {
        let mut least = 1.0_f32;
        for k in surfaces {
            let w = weight(k);
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
    Some(Estimate { surface, variance: spread / mass + 1.0 / 12.0, mass: (mass / total).min(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A parabola's minimum is found, wherever it lies between surfaces.
        #[test]
        fn a_valley_is_found_between_surfaces(at in 3.0..28.0_f32, depth in 4.0..40.0_f32) {
            let costs: Vec<u16> = (0..32).map(|k| (100.0 + depth * (k as f32 - at).powi(2)).round() as u16).collect();
            let found = estimate(&costs, &softmin_table(20.0)).unwrap();
            prop_assert!((found.surface - at).abs() < 0.15);
            prop_assert!(found.mass > 0.99);
        }

        /// Two equal valleys share the mass.
        #[test]
        fn two_valleys_are_ambiguous(a in 3..10_usize, gap in 8..15_usize) {
            let valley = |k: usize, at: usize| 40 * k.abs_diff(at).pow(2).min(20) as u16;
            let costs: Vec<u16> = (0..32).map(|k| valley(k, a).min(valley(k, a + gap))).collect();
            let found = estimate(&costs, &softmin_table(20.0)).unwrap();
            prop_assert!((found.mass - 0.5).abs() < 0.05, "{:?}", found);
        }
    }

    #[test]
    fn nothing_of_nothing() {
        assert_eq!(estimate(&[], &softmin_table(1.0)), None);
    }
}
