//! The memory of a network's predictions.

use crate::config::Config;
use crate::error::Result;
use crate::refiner::plan::limit::MemoryLimit;
use crate::refiner::plan::{PHOTOGRAPH, PROGRAM, refine_bytes};
use mde_prior::augment::Plan;
use mde_prior::{DepthPrior, InferenceMemory};

/// Bytes per pixel of the working size, for the image, the merge and the results.
const AUGMENTED: u64 = 120;
/// Bytes per pixel of a photograph that is refined at a smaller size: itself, and the maps of its own size.
const FULL: u64 = 66;
/// Bytes per pixel of the results for the files for other programs, and for the ends of an interval.
const EXPORTS: u64 = 40;
const INTERVAL: u64 = 8;
/// What the allocator holds for a prediction, in tenths of its tensors and in bytes: alone, and beside others on their own threads.
const ALONE: (u64, u64) = (14, 10 << 20);
const BESIDE: (u64, u64) = (21, 30 << 20);
/// What it keeps of a network's predictions while a field is fitted.
const KEPT: u64 = 24 << 20;

/// Estimate of the memory of one photograph's refinement, the inference of its prior included. Measured on ten settings, it is .87 to
/// 1.17 times the peak (docs/performance.md).
#[derive(Debug, Clone, Copy)]
pub struct PhotographMemory<'c> {
    config: &'c Config,
    fits_a_field: bool,
    inference: InferenceMemory,
    /// Most predictions at once.
    most: u64,
    /// Pixels of the results, where the photograph is refined at a smaller size.
    full: u64,
    /// Bytes of the photographs of a capture, and of what is written beside the maps.
    held: u64,
}

impl<'c> PhotographMemory<'c> {
    /// For a photograph of the size `full` that is refined at the size `at`, both `(height, width)`, with the predictions of `prior` on
    /// that many threads.
    pub fn new(
        config: &'c Config,
        prior: &dyn DepthPrior,
        full: (usize, usize),
        at: (usize, usize),
        threads: usize,
    ) -> Self {
        let (height, width) = at;
        let accepts_new_images = prior.accepts_new_images();
        let predictions = match accepts_new_images {
            true => {
                Plan::new(config.augmentation.predictions, at, prior.resolution(height, width)).predictions()
            }
            false => 1,
        };
        Self {
            config,
            fits_a_field: config.refinement.fits_a_field(),
            inference: prior.memory(height, width).unwrap_or_default(),
            most: prior.concurrency().min(threads).min(predictions).max(1) as u64,
            full: if full == at { 0 } else { full.0 as u64 * full.1 as u64 },
            held: 0,
        }
    }

    /// For `photographs` of one scene, all of the size `at`, which [`refine_several`](crate::several::refine_several) predicts before all else; what the
    /// sweeps and the field take is in [`scene_bytes`](super::scene_bytes).
    pub fn of_several(
        config: &'c Config,
        prior: &dyn DepthPrior,
        at: (usize, usize),
        photographs: usize,
        threads: usize,
    ) -> Self {
        let alone = Self::new(config, prior, at, at, threads);
        let images = if prior.accepts_new_images() { photographs } else { 1 };
        let most = prior.concurrency().min(threads).min(images).max(1) as u64;
        let held = PHOTOGRAPH.saturating_mul(photographs as u64);
        let held = held.saturating_mul(at.0 as u64 * at.1 as u64);
        Self { fits_a_field: false, most: alone.most.max(most), held, ..alone }
    }

    /// The same with files for other programs (`exports`) and an `interval`, for results of so many pixels.
    #[must_use]
    pub fn with_results(mut self, pixels: u64, exports: bool, interval: bool) -> Self {
        let each = EXPORTS * u64::from(exports) + INTERVAL * u64::from(interval);
        self.held = self.held.saturating_add(pixels.saturating_mul(each));
        self
    }

    /// Bytes at that number of pixels with so many predictions at once.
    pub fn bytes(&self, pixels: u64, at_once: u64) -> u64 {
        let (tenths, held) = if at_once > 1 { BESIDE } else { ALONE };
        let prediction = (self.inference.prediction / 10).saturating_mul(tenths).saturating_add(held);
        let predictions = match self.inference {
            InferenceMemory { model: 0, prediction: 0 } => 0,
            _ => prediction.saturating_mul(at_once),
        };
        let predicted = PROGRAM.saturating_add(pixels.saturating_mul(AUGMENTED)).saturating_add(predictions);
        let kept = if self.inference.model > 0 { KEPT } else { 0 };
        let fitted = match self.fits_a_field {
            true => refine_bytes(pixels, self.config).saturating_add(kept),
            false => 0,
        };
        predicted
            .max(fitted)
            .saturating_add(self.inference.model)
            .saturating_add(FULL.saturating_mul(self.full))
            .saturating_add(self.held)
    }

    /// Bytes of the loaded network, which photographs side by side share.
    pub fn shared(&self) -> u64 {
        self.inference.model
    }

    /// The number of predictions at once that fit within the limit at that size, at least 1.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::error::Error::Argument) where one does not fit; `what` names the photograph.
    pub fn predictions_at_once(&self, limit: &MemoryLimit, what: &str, at: (usize, usize)) -> Result<usize> {
        let pixels = at.0 as u64 * at.1 as u64;
        if self.inference == InferenceMemory::default() {
            limit.check(what, at, |pixels| self.bytes(pixels, 1))?;
        } else {
            limit.check_with(
                what,
                at,
                "with this network",
                |pixels| self.bytes(pixels, 1),
                |fits| match fits {
                    Some((height, width)) => {
                        format!("resize it to {} pixels a side at most", height.max(width))
                    }
                    None => "give a smaller network or a smaller input".to_owned(),
                },
            )?;
        }
        let fits = |at_once: &u64| self.bytes(pixels, *at_once) <= limit.bytes();
        Ok((1..=self.most).rev().find(fits).unwrap_or(1) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use mde_prior::augment::Predictions;
    use mde_prior::ndarray::ArrayView3;
    use mde_prior::{Error, PriorDepth};

    /// A network whose tensors take a hundred million bytes.
    struct Large(u64);

    impl DepthPrior for Large {
        fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
            Err(Error::Input("not run here".to_owned()))
        }
        fn accepts_new_images(&self) -> bool {
            true
        }
        fn concurrency(&self) -> usize {
            usize::MAX
        }
        fn memory(&self, _: usize, _: usize) -> Option<InferenceMemory> {
            Some(InferenceMemory { model: self.0, prediction: 100_000_000 })
        }
    }

    #[test]
    fn the_limit_decides_how_many_predictions_run_at_once() {
        let (config, at) = (Preset::Default.config(), (480, 640));
        let memory = PhotographMemory::new(&config, &Large(1 << 20), at, at, 8);
        let pixels = 480 * 640;
        let at_once = |bytes: u64| {
            let limit = MemoryLimit { gib: bytes as f64 / f64::from(1 << 30) };
            memory.predictions_at_once(&limit, "photo.png", at)
        };
        assert_eq!(at_once(memory.bytes(pixels, 8)).unwrap(), 8);
        assert_eq!(at_once(memory.bytes(pixels, 8) - 1).unwrap(), 7);
        assert_eq!(at_once(memory.bytes(pixels, 1)).unwrap(), 1);
        let refused = at_once(memory.bytes(0, 1) - 1).unwrap_err().to_string();
        assert!(refused.contains("photo.png") && refused.contains("a smaller network"), "{refused}");
        assert_eq!(at_once(u64::MAX).unwrap(), 8);
    }

    #[test]
    fn a_plan_or_the_photographs_bound_what_runs_at_once_and_sizes_add_up() {
        let mut config = Preset::Default.config();
        config.augmentation.predictions = Predictions::Most(1);
        let (at, large) = ((480, 640), (3000, 4000));
        let several =
            |photographs, threads| PhotographMemory::of_several(&config, &Large(0), at, photographs, threads);
        let one = PhotographMemory::new(&config, &Large(0), at, at, 8);
        assert_eq!([one, several(5, 8), several(5, 2), several(0, 2)].map(|m| m.most), [1, 5, 2, 1]);
        assert_eq!(several(5, 2).bytes(9, 2) - one.bytes(9, 2), 5 * PHOTOGRAPH * 480 * 640);
        assert_eq!(several(usize::MAX, 2).bytes(u64::MAX, u64::MAX), u64::MAX);

        let mut config = config.clone();
        config.augmentation.predictions = Predictions::Most(2);
        let of = |model, full| PhotographMemory::new(&config, &Large(model), full, at, 8);
        assert_eq!(of(0, at).most, 2);
        assert_eq!(of(5, at).bytes(9, 1) - of(0, at).bytes(9, 1), 5);
        assert_eq!(of(0, large).bytes(9, 1) - of(0, at).bytes(9, 1), FULL * 12_000_000);
        assert_eq!(of(u64::MAX, at).bytes(u64::MAX, u64::MAX), u64::MAX);
    }
}
