//! Signs that a model's output is no depth of the photograph.

use crate::config::Config;
use crate::prior::PriorOrigin;
use crate::reports::Refinement;
use mde_prior::DepthKind;
use mde_uncertainty::statistics::{median, quantile};
use ndarray::Array2;
use std::f64::consts::LN_2;

/// Share of the pixels above which missing depth is a sign.
const MISSING: f64 = 0.3;
/// Ratio of the depths' 95 and 5 % quantiles below which a map is nearly constant.
const RANGE: f64 = 1.03;
/// Metres between which a photograph has some depth: a network of rooms or streets that gives none there gives no metres.
const METRES: [f64; 2] = [0.1, 65.0];

/// Warnings about the depth that a model gave, 0 where missing; none for a map from a file. `scaled`: known depths give the scale.
pub(super) fn doubts(
    depth: &Array2<f32>,
    origin: &PriorOrigin,
    config: &Config,
    scaled: bool,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if !origin.predicts() {
        return warnings;
    }
    let name = &origin.source;
    let mut known: Vec<f64> = depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
    let missing = 1.0 - known.len() as f64 / depth.len().max(1) as f64;
    if missing > MISSING {
        warnings.push(format!(
            "{name}: no depth for {:.0} % of the pixels; check its profile, its kind and its weights",
            100.0 * missing
        ));
    }
    if let (Some(low), Some(high)) = (quantile(&mut known, 0.05), quantile(&mut known, 0.95)) {
        if high < RANGE * low {
            warnings.push(format!(
                "{name}: its depth is nearly constant, {low:.3} to {high:.3}; check its profile, its kind and its weights"
            ));
        }
        let [nearest, farthest] = METRES;
        if origin.kind == DepthKind::Metric && !scaled && (high < nearest || low > farthest) {
            warnings.push(format!(
                "{name}: its depth is from {low:.3} to {high:.3} m, where photographs have none: its values may be no metres; give {{prior-kind}} disparity or depth, or {{scale-from}}, \
                 or check its profile, its kind and its weights"
            ));
        }
    }
    if origin.kind == DepthKind::AffineDisparity && !scaled {
        warnings.push(format!(
            "{name} gives disparity of unknown scale and shift: depths of {} to {} are assumed; give {{depth-range}}, or {{scale-from}}",
            config.disparity.near, config.disparity.far
        ));
    }
    warnings
}

/// A warning where the depth of several photographs has another shape than the metres of the network that gave them their scale: a tenth of
/// the pixels differ by more than a factor of two from the common ratio.
pub(super) fn contradicted(refinement: &Refinement, origin: &PriorOrigin) -> Option<String> {
    if origin.kind != DepthKind::Metric || !origin.predicts() {
        return None;
    }
    let both =
        refinement.prior.iter().zip(refinement.depth.mean()).filter(|(prior, z)| **prior > 0.0 && **z > 0.0);
    let mut ratios: Vec<f64> = both.map(|(prior, z)| f64::from(z / prior).ln()).collect();
    let common = median(ratios.iter().copied())?;
    ratios.iter_mut().for_each(|ratio| *ratio = (*ratio - common).abs());
    let most = quantile(&mut ratios, 0.9).filter(|most| *most > LN_2)?;
    Some(format!(
        "{}: the photographs contradict its depth, a tenth of the pixels by a factor of {:.1} or more, so its metres are not to be trusted: give \
         {{scale-from}}, or {{unit}} capture where the poses have a unit",
        origin.source,
        most.exp()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use crate::prior::PriorForm;
    use mde_uncertainty::GaussianDepth;

    #[test]
    fn metres_of_a_network_that_the_photographs_contradict_are_doubted() {
        let prior = Array2::from_elem((10, 10), 2.0_f32);
        // One factor for all is no contradiction, nor is one for less than a tenth of the pixels.
        let found = |share: usize, kind| {
            let depth =
                Array2::from_shape_fn((10, 10), |(y, x)| if 10 * y + x < share { 25.0 } else { 10.0 });
            let depth = GaussianDepth::new(depth, prior.mapv(|_| 1.0)).unwrap();
            let refinement = Refinement { depth, ..Refinement::of_prior(prior.clone()) };
            contradicted(&refinement, &PriorOrigin::new(PriorForm::Network, kind, "net.onnx"))
        };
        assert_eq!(found(0, DepthKind::Metric), None);
        assert_eq!(found(8, DepthKind::Metric), None);
        let told = found(15, DepthKind::Metric).unwrap();
        assert!(told.starts_with("net.onnx:") && told.contains("a factor of 2.5 or more"), "{told}");
        assert_eq!(found(15, DepthKind::RelativeDepth), None);
    }

    #[test]
    fn missing_constant_and_assumed_depth_are_named() {
        let origin = |kind| PriorOrigin::new(PriorForm::Network, kind, "net.onnx");
        let config = Preset::Default.config();
        let found = |depth: &dyn Fn(usize) -> f32, kind| {
            let depth = Array2::from_shape_fn((10, 10), |(y, x)| depth(10 * y + x));
            doubts(&depth, &origin(kind), &config, false)
        };
        let metric = DepthKind::Metric;
        assert!(found(&|i| 1.0 + i as f32, metric).is_empty());
        let missing = found(&|i| if i < 49 { 0.0 } else { i as f32 }, metric);
        assert!(missing.len() == 1 && missing[0].contains("49 %"), "{missing:?}");
        let constant = found(&|i| 2.0 + 1e-4 * i as f32, metric);
        assert!(constant.len() == 1 && constant[0].contains("nearly constant"), "{constant:?}");
        let assumed = found(&|i| 1.0 + i as f32, DepthKind::AffineDisparity);
        assert!(assumed.len() == 1 && assumed[0].contains("0.8 to 8"), "{assumed:?}");
        for (unit, told) in [(100.0, "m, where photographs have none"), (1e-4, "{prior-kind} disparity")] {
            let wrong = found(&|i| unit * (1.0 + i as f32 / 100.0), metric);
            assert!(wrong.len() == 1 && wrong[0].contains(told), "{wrong:?}");
        }
        // A sky beyond the range is no sign.
        assert!(found(&|i| 100.0 + i as f32, DepthKind::RelativeDepth).is_empty());
        assert!(found(&|i| if i < 10 { 5.0 } else { 9e3 + 9.0 * i as f32 }, metric).is_empty());
        let file = PriorOrigin::new(PriorForm::Map, metric, "depth.npy");
        assert!(doubts(&Array2::zeros((3, 3)), &file, &config, false).is_empty());
        let ramp = Array2::from_shape_fn((10, 10), |(y, x)| (1 + 10 * y + x) as f32);
        assert!(doubts(&ramp, &origin(DepthKind::AffineDisparity), &config, true).is_empty());
    }
}
