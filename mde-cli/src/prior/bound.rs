//! A prior for one photograph.

use crate::error::Result;
use crate::prior::origin::PriorOrigin;
use mde_prior::{DepthPrior, InferenceMemory, PriorDepth};
use ndarray::{Array3, ArrayView3};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Two aspects that differ by no more are the same up to rounded sides.
const SAME_ASPECT: f64 = 0.02;

/// A prior for one photograph: a map at the size of its refinement, a network with the metres that its focal length gives.
pub(crate) struct PhotographPrior<'p> {
    prior: &'p dyn DepthPrior,
    origin: PriorOrigin,
    /// Focal length / width, where it is known.
    focal: Option<f64>,
    /// A map at another size.
    resampled: Option<PriorDepth>,
    /// Time of the predictions so far; those side by side count each.
    nanoseconds: AtomicU64,
}

impl<'p> PhotographPrior<'p> {
    /// A prior as it is.
    pub(crate) fn new(prior: &'p dyn DepthPrior, origin: &PriorOrigin) -> Self {
        Self { prior, origin: origin.clone(), focal: None, resampled: None, nanoseconds: AtomicU64::new(0) }
    }

    /// The same with a map of the size `from`, which is resampled for a photograph of `original` pixels that is refined at `to`, all
    /// `(height, width)`: where it has the photograph's aspect. A warning of it goes to `warn`.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::error::Error::Prior) where nothing of the map is left.
    pub(crate) fn resampled(
        mut self,
        from: (usize, usize),
        original: (usize, usize),
        to: (usize, usize),
        warn: &mut dyn FnMut(String),
    ) -> Result<Self> {
        let aspect = |(height, width): (usize, usize)| width as f64 / height as f64;
        if from == to || (aspect(from) / aspect(original) - 1.0).abs() > SAME_ASPECT {
            return Ok(self);
        }
        if from != original {
            let ((h, w), (height, width), source) = (from, to, &self.origin.source);
            warn(format!(
                "{source}: resized from {w}x{h} to {width}x{height} pixels, each the nearest one; make the prior at the image's size for its edges"
            ));
        }
        // A map depends on the size alone.
        let blank = Array3::zeros((from.0, from.1, 3));
        self.resampled = Some(self.prior.predict(blank.view())?.resized(to)?);
        Ok(self)
    }

    /// The same for photographs of that focal length / width, where it is known: a network whose metres depend on it has some only then.
    /// The time of its predictions begins anew.
    #[must_use]
    pub(crate) fn at_focal(mut self, focal: Option<f64>) -> Self {
        self.origin = self.origin.at_focal(focal);
        self.focal = focal;
        self.nanoseconds = AtomicU64::new(0);
        self
    }

    /// Seconds of the predictions since they were taken last.
    pub(crate) fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 * 1e-9
    }

    /// These seconds, which begin anew.
    pub(crate) fn take_seconds(&self) -> f64 {
        self.nanoseconds.swap(0, Ordering::Relaxed) as f64 * 1e-9
    }

    /// Where the predictions come from.
    pub(crate) fn origin(&self) -> &PriorOrigin {
        &self.origin
    }
}

impl DepthPrior for PhotographPrior<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        if let Some(map) = &self.resampled {
            return Ok(map.clone());
        }
        let (height, width, _) = image.dim();
        let start = Instant::now();
        let prediction = self.prior.predict(image);
        let elapsed = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_add(elapsed, Ordering::Relaxed);
        match (&self.origin.model, self.focal) {
            (Some(spec), Some(focal)) => {
                Ok(spec.in_metres(prediction?, focal, self.prior.resolution(height, width)))
            }
            _ => prediction,
        }
    }

    fn accepts_new_images(&self) -> bool {
        self.prior.accepts_new_images()
    }

    fn resolution(&self, height: usize, width: usize) -> Option<(usize, usize)> {
        self.prior.resolution(height, width)
    }

    fn concurrency(&self) -> usize {
        self.prior.concurrency()
    }

    fn memory(&self, height: usize, width: usize) -> Option<InferenceMemory> {
        self.prior.memory(height, width)
    }
}
