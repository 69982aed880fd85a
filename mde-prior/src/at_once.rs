//! Predictions side by side.

use crate::{DepthPrior, PriorDepth, Result};
use ndarray::ArrayView3;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::ops::ControlFlow;

/// Predicts every image and passes the predictions to `take` in the order of the images, until `take` returns `Break`, which is
/// returned too.
///
/// As many run at once as the model [allows](DepthPrior::concurrency) and there are threads, and no more than `at_once`, 1 or more. The
/// predictions do not depend on it.
///
/// # Errors
/// The error of the first prediction that fails, in the order of the images.
pub fn predict_each(
    model: &dyn DepthPrior,
    images: &[ArrayView3<'_, f32>],
    at_once: Option<usize>,
    take: impl FnMut(PriorDepth) -> ControlFlow<()>,
) -> Result<ControlFlow<()>> {
    AtOnce::new(model.concurrency(), at_once).in_order(images, |image| model.predict(image.view()), take)
}

/// Tasks side by side.
pub(crate) struct AtOnce {
    /// Most at once.
    pub(crate) most: usize,
    /// Threads of their own where there are fewer than usual: an allocator keeps memory for each thread that ever ran one.
    pool: Option<ThreadPool>,
}

impl AtOnce {
    /// As many as the model allows and there are threads, and no more than the limit.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DepthKind, Error};
    use ndarray::Array3;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    /// Predicts the first red value, refuses what is black, and counts what runs at once.
    #[derive(Default)]
    struct Red {
        running: AtomicUsize,
        most: AtomicUsize,
    }

    impl DepthPrior for Red {
        fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
            self.most.fetch_max(self.running.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            let red = image[(0, 0, 0)];
            // The first take longest.
            std::thread::sleep(Duration::from_millis((20.0 / red.max(1.0)) as u64));
            self.running.fetch_sub(1, Ordering::SeqCst);
            match red > 0.0 {
                true => {
                    PriorDepth::from_values(image.slice(ndarray::s![.., .., 0]).to_owned(), DepthKind::Metric)
                }
                false => Err(Error::Input("black".to_owned())),
            }
        }
        fn concurrency(&self) -> usize {
            usize::MAX
        }
    }

    fn run(reds: &[f32], at_once: Option<usize>, stop_after: usize) -> (Result<bool>, Vec<f32>, usize) {
        let images: Vec<Array3<f32>> = reds.iter().map(|red| Array3::from_elem((2, 3, 3), *red)).collect();
        let views: Vec<_> = images.iter().map(|image| image.view()).collect();
        let (model, mut taken) = (Red::default(), Vec::new());
        let threads = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let done = threads.install(|| {
            predict_each(&model, &views, at_once, |prediction| {
                taken.push(prediction.map[(0, 0)]);
                if taken.len() < stop_after { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            })
        });
        (done.map(|flow| flow.is_break()), taken, model.most.into_inner())
    }

    #[test]
    fn predictions_come_in_the_order_of_the_images_however_many_run_at_once() {
        let reds = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        for (at_once, most) in [(None, 4), (Some(9), 4), (Some(2), 2), (Some(1), 1), (Some(0), 1)] {
            let (done, taken, ran) = run(&reds, at_once, usize::MAX);
            assert!(!done.unwrap() && taken == reds && ran <= most, "{at_once:?}: {taken:?}, {ran} at once");
            assert_eq!(ran > 1, most > 1, "{at_once:?}");
        }
    }

    #[test]
    fn a_break_and_an_error_end_them() {
        let (done, taken, _) = run(&[1.0, 2.0, 3.0, 4.0, 5.0], None, 2);
        assert!(done.unwrap() && taken == [1.0, 2.0]);
        let (done, taken, _) = run(&[1.0, 0.0, 3.0], None, usize::MAX);
        assert!(done.is_err() && taken == [1.0]);
    }
}
