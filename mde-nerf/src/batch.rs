//! Which rays a step trains on.

use crate::config::TrainConfig;
use crate::frustum::Ray;
use crate::loss::Target;
use crate::march::March;
use crate::{Error, Result};
use mde_warp::PosedView;
use mde_warp::random::CounterRng;
use rand::RngExt;

/// The views' trainable pixels.
pub(crate) struct Pixels<'v> {
    views: &'v [PosedView],
    /// Per view the flat indices of the pixels that may be trained on.
    trainable: Vec<Vec<u32>>,
    /// Views other than the first that have one.
    others: Vec<usize>,
    original_share: f64,
}

impl<'v> Pixels<'v> {
    pub(crate) fn new(views: &'v [PosedView], config: &TrainConfig) -> Result<Self> {
        let mut trainable = Vec::new();
        for (index, view) in views.iter().enumerate() {
            view.validate().map_err(|error| Error::View { index, reason: error.to_string() })?;
            let pixels = view.mask.iter().enumerate().filter(|(_, real)| **real);
            trainable.push(pixels.map(|(i, _)| i as u32).collect::<Vec<_>>());
        }
        let others: Vec<usize> = (1..views.len()).filter(|&v| !trainable[v].is_empty()).collect();
        let original_share = match (trainable.first().is_none_or(Vec::is_empty), others.is_empty()) {
            (true, true) => return Err(Error::NoPixels),
            (true, false) => 0.0,
            (false, true) => 1.0,
            (false, false) => config.original_share,
        };
        Ok(Self { views, trainable, others, original_share })
    }

    /// Ray `index` of step `step`: a random trainable pixel of a random view, before a random background.
    pub(crate) fn draw(&self, seed: u64, step: usize, index: usize) -> (March, Target) {
        let mut rng = CounterRng::new(seed, "ray", step as u64, index as u64);
        let view = if rng.random::<f64>() < self.original_share {
            0
        } else {
            self.others[rng.random_range(0..self.others.len())]
        };
        let pixel = self.trainable[view][rng.random_range(0..self.trainable[view].len())];
        let background = std::array::from_fn(|_| rng.random::<f64>());
        self.ray(view, pixel, background, Some(rng))
    }

    /// A random trainable pixel of `view` for measuring, or nothing where it has none.
    pub(crate) fn probe(&self, seed: u64, view: usize, index: usize) -> Option<(March, Target)> {
        let mut rng = CounterRng::new(seed, "probe", view as u64, index as u64);
        let pixels = &self.trainable[view];
        let pixel = *pixels.get(rng.random_range(0..pixels.len().max(1)))?;
        Some(self.ray(view, pixel, [0.5; 3], None))
    }

    fn ray(&self, view: usize, pixel: u32, background: [f64; 3], rng: Option<CounterRng>) -> (March, Target) {
        let posed = &self.views[view];
        let (row, column) = (pixel as usize / posed.camera.width, pixel as usize % posed.camera.width);
        let depths: Vec<(f64, f64)> = posed
            .hypotheses
            .iter()
            .filter_map(|h| h.get(row, column))
            .filter(|&(mean, _)| mean > 0.0)
            .map(|(mean, variance)| (f64::from(mean), f64::from(variance)))
            .collect();
        let march = March {
            ray: Ray::new(&posed.camera, &posed.pose, column as f64, row as f64),
            guess: depths.first().map(|d| d.0),
            background,
            rng,
        };
        let colour = std::array::from_fn(|axis| f64::from(posed.image[(row, column, axis)]));
        (march, Target { colour, depths })
    }

    pub(crate) fn view_count(&self) -> usize {
        self.views.len()
    }
}
