use crate::{DepthKind, PriorDepth};
use ndarray::{Array2, Zip};

/// Standard deviation to which disparities are scaled: that of log depth in a typical room.
const DEVIATION: f64 = 0.3;

/// The values in which predictions are merged: log depth, or disparity times a factor.
#[derive(Clone, Copy)]
pub(super) struct Values {
    pub(super) kind: DepthKind,
    scale: f32,
}

impl Values {
    pub(super) fn of(prior: &PriorDepth) -> Self {
        if prior.kind.is_depth() {
            return Self { kind: prior.kind, scale: 1.0 };
        }
        let known = || prior.map.iter().zip(&prior.valid).filter(|(_, v)| **v).map(|(d, _)| f64::from(*d));
        let count = known().count().max(1) as f64;
        let mean = known().sum::<f64>() / count;
        let deviation = (known().map(|d| (d - mean).powi(2)).sum::<f64>() / count).sqrt();
        Self { kind: prior.kind, scale: if deviation > 0.0 { (DEVIATION / deviation) as f32 } else { 1.0 } }
    }

    /// A missing pixel takes the mean.
    pub(super) fn of_prior(self, prior: &PriorDepth) -> Array2<f32> {
        let value = |d: f32| if self.kind.is_depth() { d.ln() } else { self.scale * d };
        let mut values =
            Zip::from(&prior.map).and(&prior.valid).map_collect(|&d, &v| if v { value(d) } else { 0.0 });
        let missing = prior.valid.iter().filter(|v| !**v).count();
        if missing > 0 {
            let known = (prior.valid.len() - missing).max(1) as f64;
            let mean = (values.iter().map(|v| f64::from(*v)).sum::<f64>() / known) as f32;
            values.zip_mut_with(&prior.valid, |value, &valid| *value = if valid { *value } else { mean });
        }
        values
    }

    pub(super) fn to_prior(self, value: f32) -> f32 {
        if self.kind.is_depth() { value.exp().clamp(f32::MIN_POSITIVE, f32::MAX) } else { value / self.scale }
    }

    /// A standard deviation of values: of log depth, or of a disparity in its own unit.
    pub(super) fn spread(self, spread: f32) -> f32 {
        if self.kind.is_depth() { spread } else { spread / self.scale }
    }
}
