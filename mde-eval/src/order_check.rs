//! A model checked on procedural rooms: whether its order of near and far is that of their depth.
//!
//! Nothing in a photograph tells a disparity that is taken for a depth, which swaps near and far. The rooms' depth is known.

use crate::Result;
use crate::raster::gather;
use crate::scene::{Room, room};
use mde_prior::{DepthPrior, DisparityRule};
use mde_uncertainty::statistics::spearman;
use ndarray::Zip;

/// Width and height of the rooms' images, pixels.
pub const SIZE: [usize; 2] = [224, 168];
/// Below this mean correlation with the true depth of the rooms a model is of no use, or its profile is wrong.
const AGREES: f64 = 0.25;
/// Standard errors by which the mean correlation exceeds 0 beyond chance: 95 % of Student's distribution for seven rooms.
const CHANCE: f64 = 1.94;

/// A model's depth of one room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomCheck {
    /// The room.
    pub room: Room,
    /// Spearman's correlation of the predicted with the true depth; 0 where either is constant.
    pub correlation: f64,
    /// Share of the pixels without a prediction.
    pub missing: f64,
}

impl RoomCheck {
    /// Of a room of `[width, height]`.
    fn new(prior: &dyn DepthPrior, kind: Room, [width, height]: [usize; 2]) -> Result<Self> {
        let scene = room(kind, 0, width, height)?;
        let depth = prior.predict(scene.image.view())?.to_depth(&DisparityRule::default())?;
        let both =
            Zip::from(&depth).and(&scene.depth).map_collect(|&predicted, &z| predicted > 0.0 && z > 0.0);
        let [predicted, truth] = [&depth, &scene.depth].map(|map| gather(map.view(), both.view()));
        let missing = 1.0 - predicted.len() as f64 / depth.len().max(1) as f64;
        let correlation = spearman(&predicted, &truth)?.unwrap_or(0.0);
        Ok(Self { room: kind, correlation, missing })
    }
}

/// A model's order of near and far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// That of the rooms, beyond chance.
    True,
    /// Its reverse, beyond chance.
    Swapped,
    /// Neither.
    Chance,
}

/// A model's depth of all rooms.
#[derive(Debug, Clone, PartialEq)]
pub struct OrderCheck {
    /// One after the other.
    pub rooms: Vec<RoomCheck>,
}

impl OrderCheck {
    /// Predicts all rooms.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::Error::Prior) where the model fails.
    pub fn new(prior: &dyn DepthPrior) -> Result<Self> {
        let rooms = Room::ALL.into_iter().map(|kind| RoomCheck::new(prior, kind, SIZE));
        Ok(Self { rooms: rooms.collect::<Result<_>>()? })
    }

    /// The check of a model that swaps near and far beyond chance; nothing for others. One prediction of a small room settles most models;
    /// where its order is swapped, all rooms are predicted.
    ///
    /// # Errors
    /// As [`OrderCheck::new`].
    pub fn swapped(prior: &dyn DepthPrior) -> Result<Option<Self>> {
        let first = RoomCheck::new(prior, Room::ALL[0], SIZE.map(|side| side / 2))?;
        if first.correlation > -AGREES {
            return Ok(None);
        }
        Ok(Some(Self::new(prior)?).filter(|check| check.order() == Order::Swapped))
    }

    /// Mean of the correlations.
    pub fn mean(&self) -> f64 {
        self.rooms.iter().map(|found| found.correlation).sum::<f64>() / self.rooms.len() as f64
    }

    /// Whether the correlations are of one sign beyond chance, and not too small to be of use.
    pub fn order(&self) -> Order {
        let (mean, count) = (self.mean(), self.rooms.len() as f64);
        let squares: f64 = self.rooms.iter().map(|found| (found.correlation - mean).powi(2)).sum();
        let error = (squares / (count * (count - 1.0))).sqrt();
        if mean.abs() <= AGREES || mean.abs() <= CHANCE * error {
            Order::Chance
        } else if mean > 0.0 {
            Order::True
        } else {
            Order::Swapped
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_prior::{DepthKind, PriorDepth};
    use ndarray::ArrayView3;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Depth by the row of a pixel: rooms are nearer below.
    struct ByRow {
        swapped: bool,
        predictions: AtomicUsize,
    }

    impl DepthPrior for ByRow {
        fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
            self.predictions.fetch_add(1, Ordering::Relaxed);
            let (height, width, _) = image.dim();
            let depth = |(y, _)| 1.0 + if self.swapped { y as f32 } else { (height - y) as f32 };
            PriorDepth::from_values(ndarray::Array2::from_shape_fn((height, width), depth), DepthKind::Metric)
        }
    }

    #[test]
    fn a_swapped_order_is_told_and_another_costs_one_prediction() {
        let model = |swapped| ByRow { swapped, predictions: AtomicUsize::new(0) };
        let (right, wrong) = (model(false), model(true));
        assert_eq!(OrderCheck::new(&right).unwrap().order(), Order::True);
        assert_eq!(right.predictions.swap(0, Ordering::Relaxed), Room::ALL.len());
        assert_eq!(OrderCheck::swapped(&right).unwrap(), None);
        assert_eq!(right.predictions.into_inner(), 1);
        let told = OrderCheck::swapped(&wrong).unwrap().unwrap();
        assert!(told.mean() < -AGREES && told == OrderCheck::new(&wrong).unwrap(), "{told:?}");
    }
}
