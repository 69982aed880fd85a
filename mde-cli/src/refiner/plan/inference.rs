//! The memory of a network's predictions.

use crate::config::Config;
use crate::error::Result;
use crate::refiner::MemoryLimit;
use crate::refiner::plan::{MIB, PROGRAM, held, refine_bytes};
use mde_prior::augment::Plan;
use mde_prior::{DepthPrior, InferenceMemory};

/// Bytes per pixel of the working size, for the image, the merge and the results.
const AUGMENTED: f64 = 120.0;
/// Bytes per pixel of a photograph that is refined at a smaller size: itself, and the maps of its own size.
const FULL: f64 = 66.0;
/// What the allocator holds for a prediction, as a factor on its tensors and in bytes: alone, and beside others on their own threads.
const ALONE: (f64, f64) = (1.4, 0.0);
const BESIDE: (f64, f64) = (2.1, 12.0 * MIB);
/// What it keeps of a network's predictions afterwards.
const KEPT: f64 = 24.0 * MIB;

/// Memory of one photograph's refinement, with the prior's inference. With FastDepth it is .90 to 1.31 times the peak (docs/performance.md).
#[derive(Debug, Clone, Copy)]
pub struct PhotographMemory<'c> {
    config: &'c Config,
    fits_a_field: bool,
    pub(crate) inference: InferenceMemory,
    /// Most predictions at once.
    most: u64,
    /// Bytes of all photographs, and of what is written beside the maps.
    pub(crate) held: f64,
}

impl<'c> PhotographMemory<'c> {
    /// For `photographs` of the size `full` that are refined at the size `at`, both `(height, width)`, with the predictions of `prior` on
    /// that many threads. Several are predicted before all else; what their sweeps and field take is in [`scene_bytes`](super::scene_bytes).
    pub fn new(
        config: &'c Config,
        prior: &dyn DepthPrior,
        [full, at]: [(usize, usize); 2],
        photographs: usize,
        threads: usize,
    ) -> Self {
        let (height, width) = at;
        let predictions = match prior.accepts_new_images() {
            true => Plan::new(config.augmentation.predictions, at, prior.resolution(height, width))
                .predictions()
                .max(photographs),
            false => 1,
        };
        let pixels = |(height, width)| height as f64 * width as f64;
        Self {
            config,
            fits_a_field: photographs < 2 && config.refinement.fits_a_field(),
            inference: prior.memory(height, width).unwrap_or_default(),
            most: prior.concurrency().min(threads).min(predictions).max(1) as u64,
            held: match photographs {
                0 | 1 if full == at => 0.0,
                0 | 1 => FULL * pixels(full),
                _ => held(photographs as u64, photographs as u64) * pixels(at),
            },
        }
    }

    /// Bytes at that number of pixels with so many predictions at once.
    pub fn bytes(&self, pixels: u64, at_once: u64) -> u64 {
        let (factor, more) = if at_once > 1 { BESIDE } else { ALONE };
        let InferenceMemory { model, prediction } = self.inference;
        let mut predicted = PROGRAM + AUGMENTED * pixels as f64;
        if self.inference != InferenceMemory::default() {
            predicted += at_once as f64 * (factor * prediction as f64 + more);
        }
        let fitted = match self.fits_a_field {
            true => refine_bytes(pixels, self.config) as f64 + (self.afterwards() - model) as f64,
            false => 0.0,
        };
        (predicted.max(fitted) + model as f64 + self.held) as u64
    }

    /// Bytes that the network takes after its predictions.
    pub(crate) fn afterwards(&self) -> u64 {
        let model = self.inference.model;
        model.saturating_add(if model > 0 { KEPT as u64 } else { 0 })
    }

    /// The number of predictions at once that fit within the limit at that size, at least 1.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::error::Error::Argument) where one does not fit; `what` names the photograph.
    pub fn predictions_at_once(&self, limit: &MemoryLimit, what: &str, at: (usize, usize)) -> Result<usize> {
        let alone = |pixels| self.bytes(pixels, 1);
        if self.inference == InferenceMemory::default() {
            limit.check(what, at, alone)?;
        } else {
            limit.check_with(what, at, "with this network", alone, |fits| match fits {
                Some((height, width)) => format!("resize it to {} pixels a side at most", height.max(width)),
                None => "give a smaller network or a smaller input".to_owned(),
            })?;
        }
        let fits = |at_once: &u64| self.bytes(at.0 as u64 * at.1 as u64, *at_once) <= limit.bytes();
        Ok((1..=self.most).rev().find(fits).unwrap_or(1) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use crate::refiner::tests::Network;
    use mde_prior::augment::Predictions;

    fn network(bytes: u64) -> Network {
        Network { known: None, bytes }
    }

    #[test]
    fn the_limit_decides_how_many_predictions_run_at_once() {
        let (config, at) = (Preset::Default.config(), (480, 640));
        let memory = PhotographMemory::new(&config, &network(1 << 20), [at; 2], 1, 8);
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
            |photographs, threads| PhotographMemory::new(&config, &network(0), [at; 2], photographs, threads);
        let one = several(1, 8);
        assert_eq!([one, several(5, 8), several(5, 2), several(0, 2)].map(|m| m.most), [1, 5, 2, 1]);
        assert_eq!(several(5, 2).bytes(9, 2) - one.bytes(9, 2), held(5, 5) as u64 * 480 * 640);
        assert_eq!(several(usize::MAX, 2).bytes(u64::MAX, u64::MAX), u64::MAX);

        let mut config = config.clone();
        config.augmentation.predictions = Predictions::Most(2);
        let of = |model, full| PhotographMemory::new(&config, &network(model), [full, at], 1, 8);
        assert_eq!(of(0, at).most, 2);
        assert_eq!(of(5, at).bytes(9, 1) - of(0, at).bytes(9, 1), 5);
        assert_eq!(of(0, large).bytes(9, 1) - of(0, at).bytes(9, 1), FULL as u64 * 12_000_000);
        assert_eq!(of(u64::MAX, at).bytes(u64::MAX, u64::MAX), u64::MAX);
    }
}
