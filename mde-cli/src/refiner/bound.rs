//! A prior for one photograph.

use crate::error::Result;
use crate::prior::{OpenPrior, PriorOrigin};
use crate::scene::Photograph;
use mde_prior::{DepthPrior, InferenceMemory, PriorDepth};
use ndarray::{Array3, ArrayView3};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Two aspects that differ by no more are the same up to rounded sides.
const SAME_ASPECT: f64 = 0.02;

/// A prior for one photograph: a map at the size of its refinement, a network with the metres that its focal length gives.
pub(super) struct PhotographPrior<'p> {
    prior: &'p dyn DepthPrior,
    pub(super) origin: PriorOrigin,
    /// Focal length / width, where it is known.
    focal: Option<f64>,
    /// A map at another size.
    resampled: Option<PriorDepth>,
    /// Time of the predictions so far; those side by side count each.
    nanoseconds: AtomicU64,
}

impl<'p> PhotographPrior<'p> {
    /// For a photograph of that focal length / width, where it is known: a network whose metres depend on it has some only then. A map of
    /// the photograph's aspect is resampled to its size; a warning of that goes to `warn`.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::error::Error::Prior) where nothing of the map is left.
    pub(super) fn new(
        open: &'p OpenPrior<'p>,
        photograph: &Photograph,
        focal: Option<f64>,
        warn: &mut dyn FnMut(String),
    ) -> Result<Self> {
        let (prior, origin) = (open.prior(), open.origin().at_focal(focal));
        let (original, to) = (photograph.original, photograph.size());
        let from = open.size.unwrap_or(original);
        let aspect = |(height, width): (usize, usize)| width as f64 / height as f64;
        let is_alike = (aspect(from) / aspect(original) - 1.0).abs() <= SAME_ASPECT;
        let mut resampled = None;
        if !prior.accepts_new_images() && from != to && is_alike {
            if from != original {
                let ((h, w), (height, width), source) = (from, to, &origin.source);
                warn(format!(
                    "{source}: resized from {w}x{h} to {width}x{height} pixels, each the nearest one; make the prior at the image's size for its edges"
                ));
            }
            // A map depends on the size alone.
            let blank = Array3::zeros((from.0, from.1, 3));
            resampled = Some(prior.predict(blank.view())?.resized(to)?);
        }
        Ok(Self { prior, origin, focal, resampled, nanoseconds: AtomicU64::new(0) })
    }

    /// Seconds of the predictions since they were taken last.
    pub(super) fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 * 1e-9
    }

    /// These seconds, which begin anew.
    pub(super) fn take_seconds(&self) -> f64 {
        self.nanoseconds.swap(0, Ordering::Relaxed) as f64 * 1e-9
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
