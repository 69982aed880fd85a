//! Priors around priors.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use ndarray::ArrayView3;

use super::forward;
use crate::{DepthPrior, ModelSpec, PriorDepth, Result};

/// A network with a [canonical focal length](ModelSpec::canonical_focal), for photographs of a known one: its depth times
/// \\(f / f_c\\), so in metres.
pub struct Metres<'p> {
    prior: &'p dyn DepthPrior,
    spec: &'p ModelSpec,
    focal: f64,
}

impl<'p> Metres<'p> {
    /// `focal` is the photographs' focal length / their width. `None` for a network without a canonical focal length, whose
    /// depth does not depend on it.
    #[must_use]
    pub fn new(prior: &'p dyn DepthPrior, spec: &'p ModelSpec, focal: f64) -> Option<Self> {
        spec.canonical_focal.map(|_| Self { prior, spec, focal })
    }
}

impl DepthPrior for Metres<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let prediction = self.prior.predict(image)?;
        let input = self.prior.resolution(height, width).unwrap_or((height, width));
        let factor = self.spec.metres(self.focal, (height, width), input).unwrap_or(1.0);
        Ok(PriorDepth { map: prediction.map.mapv(|z| factor * z), kind: self.spec.output, ..prediction })
    }

    forward!(|self| self.prior);
}

/// A prior that measures the time of its predictions.
pub struct Timed<P> {
    prior: P,
    nanoseconds: AtomicU64,
}

impl<P: DepthPrior> Timed<P> {
    /// No time measured yet.
    #[must_use]
    pub fn new(prior: P) -> Self {
        Self { prior, nanoseconds: AtomicU64::new(0) }
    }

    /// The sum over all predictions so far; those side by side count each.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 * 1e-9
    }
}

impl<P: DepthPrior> DepthPrior for Timed<P> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let start = Instant::now();
        let prediction = self.prior.predict(image);
        let elapsed = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_add(elapsed, Ordering::Relaxed);
        prediction
    }

    forward!(|self| self.prior);
}
