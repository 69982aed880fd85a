//! Several images side by side.

use mde_prior::ndarray::{Array3, ArrayView3, s};
use mde_prior::{DepthKind, DepthPrior, Error, PriorDepth, Result, predict_each};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Predicts the first red value, has nothing for black, refuses less, and counts what runs at once.
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
        if red < 0.0 {
            return Err(Error::Input("less than black".to_owned()));
        }
        PriorDepth::from_values(image.slice(s![.., .., 0]).to_owned(), DepthKind::Metric)
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
            taken.push(prediction.map_or(0.0, |prediction| prediction.map[(0, 0)]));
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
    let (done, taken, _) = run(&[1.0, 0.0, -1.0, 3.0], None, usize::MAX);
    assert!(done.is_err() && taken == [1.0, 0.0]);
}
