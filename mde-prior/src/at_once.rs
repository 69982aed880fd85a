//! Predictions side by side.

use crate::{DepthPrior, Error, PriorDepth, Result};
use ndarray::ArrayView3;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::ops::ControlFlow;

/// Predicts every image and passes the predictions to `take` in the order of the images, or [`Error::Empty`] for one without a usable
/// pixel, until `take` returns `Break`, which is returned too.
///
/// As many run at once as the model [allows](DepthPrior::concurrency) and there are threads, and no more than `at_once`, 1 or more. The
/// predictions do not depend on it.
///
/// # Errors
/// The first other error, in the order of the images.
pub fn predict_each(
    model: &dyn DepthPrior,
    images: &[ArrayView3<'_, f32>],
    at_once: Option<usize>,
    take: impl FnMut(Result<PriorDepth>) -> ControlFlow<()>,
) -> Result<ControlFlow<()>> {
    let predict = |image: &ArrayView3<'_, f32>| match model.predict(image.view()) {
        Err(error) if !matches!(error, Error::Empty(_)) => Err(error),
        prediction => Ok(prediction),
    };
    AtOnce::new(model.concurrency(), at_once).in_order(images, predict, take)
}

/// Tasks side by side.
pub(crate) struct AtOnce {
    /// Most at once.
    most: usize,
    /// Threads of their own where there are fewer than usual: an allocator keeps memory for each thread that ever ran one.
    pool: Option<ThreadPool>,
}

impl AtOnce {
    pub(crate) fn new(concurrency: usize, limit: Option<usize>) -> Self {
        let threads = rayon::current_num_threads();
        let most = limit.unwrap_or(threads).min(concurrency).clamp(1, threads);
        if most == 1 || most == threads {
            return Self { most, pool: None };
        }
        match ThreadPoolBuilder::new().num_threads(most).build() {
            Ok(pool) => Self { most, pool: Some(pool) },
            // No threads to be had.
            Err(_) => Self { most: 1, pool: None },
        }
    }

    /// Runs `task` on each input and passes the results to `take` in the order of the inputs.
    pub(crate) fn in_order<I: Sync, O: Send>(
        &self,
        inputs: &[I],
        task: impl Fn(&I) -> Result<O> + Sync,
        mut take: impl FnMut(O) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        for inputs in inputs.chunks(self.most) {
            let all = || inputs.par_iter().map(&task).collect();
            let outputs: Vec<Result<O>> = match (inputs, &self.pool) {
                ([input], _) => vec![task(input)],
                (_, Some(pool)) => pool.install(all),
                (_, None) => all(),
            };
            for output in outputs {
                if take(output?).is_break() {
                    return Ok(ControlFlow::Break(()));
                }
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}
