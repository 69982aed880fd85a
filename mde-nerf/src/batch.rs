//! Which rays a step trains on.

use crate::config::{SmoothnessConfig, TrainConfig};
use crate::frustum::Ray;
use crate::loss::Target;
use crate::march::March;
use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_warp::PosedView;
use rand::RngExt;

/// The views' trainable pixels.
pub(crate) struct Pixels<'v> {
    views: &'v [PosedView],
    /// Per view the flat indices of the pixels that may be trained on.
    trainable: Vec<Vec<u32>>,
    /// Views other than the first that have one.
    others: Vec<usize>,
    original_share: f64,
    smoothness: SmoothnessConfig,
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
        Ok(Self { views, trainable, others, original_share, smoothness: config.smoothness })
    }

    /// Whether rays come in pairs of neighbours, an even one first.
    pub(crate) fn paired(&self) -> bool {
        self.smoothness.weight > 0.0
    }

    /// Ray `index` of step `step`: a random trainable pixel of a random view, before a random background; or, the second
    /// of a pair, a neighbour of the one before it, if that has one that may be trained on.
    pub(crate) fn draw(&self, seed: u64, step: usize, index: usize) -> (March, Target) {
        let (view, pixel, background, rng) = self.choose(seed, step, index);
        if !self.paired() || index.is_multiple_of(2) {
            return self.ray(view, pixel, background, Some(rng));
        }
        let (view_before, before, ..) = self.choose(seed, step, index - 1);
        let mut which = CounterRng::new(seed, "neighbour", step as u64, index as u64);
        match self.neighbour(view_before, before, which.random_range(0..4)) {
            Some(neighbour) => {
                let (march, mut target) = self.ray(view_before, neighbour, background, Some(rng));
                target.alike = self.smoothness.weight * self.likeness(view_before, before, neighbour);
                (march, target)
            }
            None => self.ray(view, pixel, background, Some(rng)),
        }
    }

    fn choose(&self, seed: u64, step: usize, index: usize) -> (usize, u32, [f64; 3], CounterRng) {
        let mut rng = CounterRng::new(seed, "ray", step as u64, index as u64);
        let view = if rng.random::<f64>() < self.original_share {
            0
        } else {
            self.others[rng.random_range(0..self.others.len())]
        };
        let pixel = self.trainable[view][rng.random_range(0..self.trainable[view].len())];
        let background = std::array::from_fn(|_| rng.random::<f64>());
        (view, pixel, background, rng)
    }

    /// The pixel to the right, to the left, below or above, where it may be trained on.
    fn neighbour(&self, view: usize, pixel: u32, side: usize) -> Option<u32> {
        let posed = &self.views[view];
        let width = posed.camera.width;
        let (row, column) = (pixel as usize / width, pixel as usize % width);
        let (row, column) = match side {
            0 => (row, column + 1),
            1 => (row, column.checked_sub(1)?),
            2 => (row + 1, column),
            _ => (row.checked_sub(1)?, column),
        };
        let real = *posed.mask.get((row, column))?;
        real.then_some((row * width + column) as u32)
    }

    /// \\(e^{-\lVert I_p - I_q \rVert / \kappa}\\).
    fn likeness(&self, view: usize, p: u32, q: u32) -> f64 {
        let posed = &self.views[view];
        let at = |pixel: u32, axis: usize| {
            let (row, column) = (pixel as usize / posed.camera.width, pixel as usize % posed.camera.width);
            f64::from(posed.image[(row, column, axis)])
        };
        let squared: f64 = (0..3).map(|axis| (at(p, axis) - at(q, axis)).powi(2)).sum();
        (-squared.sqrt() / self.smoothness.contrast).exp()
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
        (march, Target { colour, depths, alike: 0.0 })
    }

    pub(crate) fn view_count(&self) -> usize {
        self.views.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_warp::{PinholeCamera, Pose};
    use ndarray::{Array2, Array3};

    const SIZE: (usize, usize) = (6, 8);

    /// Black on the left, white on the right, and one pixel in five that may not be trained on.
    fn view() -> PosedView {
        PosedView::new(
            Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(_, x, _)| if x < 4 { 0.0 } else { 1.0 }),
            PinholeCamera::from_fov(60.0, SIZE.1, SIZE.0).unwrap(),
            Pose::identity(),
            Array2::from_shape_fn(SIZE, |(y, x)| !(y * SIZE.1 + x).is_multiple_of(5)),
            Vec::new(),
        )
        .unwrap()
    }

    #[test]
    fn every_second_ray_is_a_neighbour_and_edges_of_the_picture_let_go() {
        let views = [view()];
        let smoothness = SmoothnessConfig { weight: 2.0, contrast: 0.5 };
        let config = TrainConfig { smoothness, ..TrainConfig::default() };
        let pixels = Pixels::new(&views, &config).unwrap();
        let place = |march: &March| {
            let camera = &views[0].camera;
            let d = march.ray.direction;
            let [x, y] = [d.x / d.z * camera.fx + camera.cx, d.y / d.z * camera.fy + camera.cy];
            (y.round() as i64, x.round() as i64)
        };
        let (mut held, mut let_go) = (0, 0);
        for index in (0..400).step_by(2) {
            let [(first, alone), (second, target)] = [index, index + 1].map(|i| pixels.draw(3, 7, i));
            assert_eq!(alone.alike, 0.0);
            let ((y, x), (v, u)) = (place(&first), place(&second));
            assert!(views[0].mask[(v as usize, u as usize)]);
            if target.alike == 0.0 {
                continue;
            }
            assert_eq!((y - v).abs() + (x - u).abs(), 1);
            let across = (x < 4) != (u < 4);
            let expected = if across { 2.0 * (-(3.0_f64.sqrt()) / 0.5).exp() } else { 2.0 };
            assert!((target.alike - expected).abs() < 1e-6);
            *if across { &mut let_go } else { &mut held } += 1;
        }
        assert!(held > 50 && let_go > 5, "{held} {let_go}");
    }

    #[test]
    fn without_smoothness_rays_are_independent() {
        let views = [view()];
        let pixels = Pixels::new(&views, &TrainConfig::default()).unwrap();
        assert!((0..100).all(|index| pixels.draw(3, 7, index).1.alike == 0.0));
    }
}
