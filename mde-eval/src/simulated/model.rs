use super::{close, waves};
use crate::capture::Capture;
use crate::error::check;
use crate::raster::same_shape;
use crate::scene::World;
use crate::{Error, Result};
use mde_prior::{DepthKind, DepthPrior, PriorDepth};
use mde_uncertainty::random::derived_seed;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Zip, indices, s};
use serde::Serialize;

/// Faults of a [`SimulatedModel`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SimulatedModelConfig {
    /// Side of the prediction, pixels: every image is reduced to this size.
    pub side: usize,
    /// Things in front of a background that are narrower than this vanish, in pixels of the prediction: a crop brings them back.
    pub lost_cells: f64,
    /// Things that are narrower than this vanish from every prediction, as a fraction of the photograph's width.
    pub lost_width: f64,
    /// Standard deviation of the logarithm of a low-frequency error that is the same in all predictions.
    pub shared_error: f64,
    /// Standard deviation of the logarithm of a low-frequency error that differs between predictions.
    pub own_error: f64,
    /// Seed of both.
    pub seed: u64,
}

impl Default for SimulatedModelConfig {
    /// All faults at once, as a small network has them.
    fn default() -> Self {
        Self { side: 112, lost_cells: 2.0, lost_width: 0.01, shared_error: 0.05, own_error: 0.05, seed: 0 }
    }
}

impl SimulatedModelConfig {
    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] names the field and what it must be.
    pub fn validate(&self) -> Result<()> {
        let error = |value: f64| (0.0..=1.0).contains(&value);
        check([
            ("side", self.side as f64, (4..=4096).contains(&self.side), "use 4 to 4096"),
            ("lost-cells", self.lost_cells, (0.0..=64.0).contains(&self.lost_cells), "use 0 to 64"),
            ("lost-width", self.lost_width, (0.0..=0.25).contains(&self.lost_width), "use 0 to 0.25"),
            ("shared-error", self.shared_error, error(self.shared_error), "use 0 to 1"),
            ("own-error", self.own_error, error(self.own_error), "use 0 to 1"),
        ])
    }
}

/// A model of photographs whose true depths are known, for their crops and mirror images.
///
/// It finds the crop in a photograph and predicts the true depth as a network of [`side`](SimulatedModelConfig::side) pixels
/// would see it: the harmonic mean over each cell, linear between cells, thin things lost, bent by waves of its own and by waves
/// that all predictions of the photograph share. Which of these faults remain shows what test-time augmentation can remove.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedModel(Vec<Known>);

/// A photograph and its disparity with the faults that all predictions share.
#[derive(Debug, Clone, PartialEq)]
struct Known {
    image: Array3<f32>,
    disparity: Array2<f64>,
    config: SimulatedModelConfig,
}

impl SimulatedModel {
    /// A model of this photograph (`[height, width, 3]`) and its exact depth (`[height, width]`, positive everywhere).
    ///
    /// # Errors
    /// [`Error::Config`]; [`Error::Shape`] for maps of two sizes; [`Error::Value`] for a depth that is missing.
    pub fn new(image: &Array3<f32>, depth: &Array2<f32>, config: SimulatedModelConfig) -> Result<Self> {
        Ok(Self(vec![Known::new(image.view(), depth, config)?]))
    }

    /// A model of the photographs of a capture of this room. They share the faults but not the errors, as predictions of one
    /// network do: each has a seed of its own derived from that of `config`.
    ///
    /// # Errors
    /// As [`SimulatedModel::new`].
    pub fn of_capture(world: &World, capture: &Capture, config: &SimulatedModelConfig) -> Result<Self> {
        let models = capture.views.iter().zip(0..).map(|(known, index)| {
            let pose = known.true_pose.unwrap_or(known.view.pose);
            let depth = world.depth(&known.view.camera, &pose);
            let seed = derived_seed(config.seed, "simulated-models", index);
            Known::new(known.view.image.view(), &depth, SimulatedModelConfig { seed, ..config.clone() })
        });
        Ok(Self(models.collect::<Result<_>>()?))
    }
}

impl Known {
    fn new(image: ArrayView3<'_, f32>, depth: &Array2<f32>, config: SimulatedModelConfig) -> Result<Self> {
        config.validate()?;
        let (height, width, _) = image.dim();
        same_shape("the depth", depth.dim(), (height, width))?;
        if let Some((index, z)) = depth.iter().enumerate().find(|(_, z)| !(**z > 0.0 && z.is_finite())) {
            let (what, value) = ("the depth", f64::from(*z));
            return Err(Error::Value { what, index, value, expected: "positive and finite everywhere" });
        }
        let radius = (0.5 * config.lost_width * width as f64).round() as usize;
        let bend = waves(depth.dim(), ("simulated-model", config.seed, 0));
        let kept = close(&depth.mapv(f64::from), radius);
        let disparity =
            Zip::from(&kept).and(&bend).map_collect(|&z, &f| (-config.shared_error * f).exp() / z);
        Ok(Self { image: image.to_owned(), disparity, config })
    }

    /// Top row, left column and whether it is mirrored, of an image in the photograph.
    fn find(&self, picture: ArrayView3<'_, f32>) -> Option<(usize, usize, bool)> {
        let (height, width, _) = picture.dim();
        let (rows, columns, _) = self.image.dim();
        if height == 0 || width == 0 || height > rows || width > columns {
            return None;
        }
        let views = [picture, picture.slice(s![.., ..;-1, ..])];
        indices((rows - height + 1, columns - width + 1)).into_iter().find_map(|(y, x)| {
            let window = self.image.slice(s![y..y + height, x..x + width, ..]);
            // A whole comparison ends at its first difference, nearly always in its first row.
            let seen = views.iter().position(|view| window == view)?;
            Some((y, x, seen == 1))
        })
    }

    /// The disparity of a part of the photograph, as the network predicts it.
    fn seen(&self, part: ArrayView2<'_, f64>, call: u64) -> Array2<f64> {
        let SimulatedModelConfig { side, lost_cells, own_error, seed, .. } = self.config;
        let cells = (side.min(part.nrows()), side.min(part.ncols()));
        let mut small = shrunk(part, cells);
        let radius = (0.5 * lost_cells).round() as usize;
        if radius > 0 {
            small = close(&small.mapv(|d| f64::from(d.recip() as f32)), radius).mapv(f64::recip);
        }
        if own_error > 0.0 {
            let bend = waves(cells, ("simulated-question", seed, call));
            small.zip_mut_with(&bend, |d, f| *d *= (-own_error * f).exp());
        }
        grown(small.view(), part.dim())
    }
}

impl DepthPrior for SimulatedModel {
    /// # Errors
    /// [`mde_prior::Error::Input`] for an image that is neither a part of a photograph nor the mirror image of one.
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let found = self.0.iter().find_map(|known| Some((known, known.find(image)?)));
        let Some((known, (y, x, mirrored))) = found else {
            return Err(mde_prior::Error::Input(
                "the simulated model has not seen the photograph; give its own, crops and mirror images of them".to_owned(),
            ));
        };
        let (height, width, _) = image.dim();
        let place = [y, x, height, width, usize::from(mirrored)];
        let call =
            place.iter().fold(0, |hash: u64, &part| hash.wrapping_mul(0x1_0001).wrapping_add(part as u64));
        let mut seen = known.seen(known.disparity.slice(s![y..y + height, x..x + width]), call);
        if mirrored {
            seen.invert_axis(ndarray::Axis(1));
        }
        PriorDepth::from_values(seen.mapv(|d| d.recip() as f32), DepthKind::Metric)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }
}

/// The mean over each of `cells` by `cells` parts.
fn shrunk(map: ArrayView2<'_, f64>, (rows, columns): (usize, usize)) -> Array2<f64> {
    let (height, width) = map.dim();
    // A pixel that is cut counts for both: cells are much larger than pixels where that matters.
    let part = |index: usize, parts: usize, length: usize| {
        index * length / parts..((index + 1) * length).div_ceil(parts)
    };
    Array2::from_shape_fn((rows, columns), |(r, c)| {
        map.slice(s![part(r, rows, height), part(c, columns, width)]).mean().unwrap_or(0.0)
    })
}

/// Bilinear between the cells' middles, flat beyond the outer ones.
fn grown(small: ArrayView2<'_, f64>, (height, width): (usize, usize)) -> Array2<f64> {
    let place = |index: usize, cells: usize, length: usize| {
        let at = ((index as f64 + 0.5) * cells as f64 / length as f64 - 0.5).clamp(0.0, cells as f64 - 1.0);
        (at as usize, (at as usize + 1).min(cells - 1), at.fract())
    };
    Array2::from_shape_fn((height, width), |(y, x)| {
        let (top, bottom, down) = place(y, small.nrows(), height);
        let (left, right, along) = place(x, small.ncols(), width);
        let row = |r: usize| small[(r, left)] + along * (small[(r, right)] - small[(r, left)]);
        row(top) + down * (row(bottom) - row(top))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{CaptureConfig, Room, room};

    fn model(config: SimulatedModelConfig) -> (SimulatedModel, Array3<f32>, Array2<f32>) {
        let scene = room(Room::Study, 1, 80, 60).unwrap();
        (SimulatedModel::new(&scene.image, &scene.depth, config).unwrap(), scene.image, scene.depth)
    }

    /// No fault but a small prediction.
    fn small(side: usize) -> SimulatedModelConfig {
        let [lost_cells, lost_width, shared_error, own_error] = [0.0; 4];
        SimulatedModelConfig { side, lost_cells, lost_width, shared_error, own_error, seed: 0 }
    }

    fn error(prediction: &PriorDepth, truth: ArrayView2<'_, f32>) -> f32 {
        let logs = prediction.map.iter().zip(truth).map(|(a, t)| (a / t).ln().abs());
        logs.sum::<f32>() / prediction.map.len() as f32
    }

    #[test]
    fn a_crop_is_seen_more_sharply_than_the_whole() {
        let (model, image, depth) = model(small(15));
        let whole = model.predict(image.view()).unwrap();
        let part = s![10..40, 20..60];
        let crop = model.predict(image.slice(s![10..40, 20..60, ..])).unwrap();
        let of_whole = PriorDepth::from_values(whole.map.slice(part).to_owned(), DepthKind::Metric).unwrap();
        let truth = depth.slice(part);
        assert!(error(&crop, truth) < 0.8 * error(&of_whole, truth));
    }

    #[test]
    fn own_errors_differ_between_predictions_and_shared_ones_do_not() {
        let faults = |shared_error, own_error| {
            let config = SimulatedModelConfig { shared_error, own_error, ..small(4096) };
            let (model, image, depth) = model(config);
            let predicted = |image: ArrayView3<'_, f32>| model.predict(image).unwrap().map;
            let straight = (predicted(image.view()) / &depth).mapv(f32::ln);
            let mirrored = predicted(image.slice(s![.., ..;-1, ..]));
            let apart = &straight - (&mirrored.slice(s![.., ..;-1]) / &depth).mapv(f32::ln);
            [straight, apart].map(|map| map.mapv(|v| v * v).mean().unwrap().sqrt())
        };
        let [size, apart] = faults(0.05, 0.0);
        assert!((size - 0.05).abs() < 0.01 && apart < 1e-5, "{size} {apart}");
        let [size, apart] = faults(0.0, 0.05);
        assert!((size - 0.05).abs() < 0.01 && apart > 0.03, "{size} {apart}");
    }

    #[test]
    fn at_full_size_and_without_faults_it_predicts_the_truth_of_every_photograph_and_crop() {
        let world = World::new(Room::Study, 0).unwrap();
        let config = CaptureConfig { views: 2, ..CaptureConfig::default() };
        let capture = world.capture("study", &config, 64, 48).unwrap();
        let models = SimulatedModel::of_capture(&world, &capture, &small(4096)).unwrap();
        for photograph in &capture.views {
            let image = &photograph.view.image;
            let depth = world.depth(&photograph.view.camera, &photograph.view.pose);
            assert!(error(&models.predict(image.view()).unwrap(), depth.view()) < 1e-6);
            let mirrored = models.predict(image.slice(s![.., ..;-1, ..])).unwrap();
            assert!(error(&mirrored, depth.slice(s![.., ..;-1])) < 1e-6);
            let crop = models.predict(image.slice(s![8..40, 12..50, ..])).unwrap();
            assert!(error(&crop, depth.slice(s![8..40, 12..50])) < 1e-6);
        }
    }

    #[test]
    fn what_it_does_not_know_is_refused() {
        let (model, image, depth) = model(SimulatedModelConfig::default());
        assert!(model.predict(Array3::from_elem((20, 20, 3), 2.0).view()).is_err());
        assert!(model.predict(Array3::zeros((100, 100, 3)).view()).is_err());
        let mut hole = depth.clone();
        hole[(3, 4)] = 0.0;
        let config = SimulatedModelConfig::default;
        assert!(SimulatedModel::new(&image, &hole, config()).is_err());
        assert!(SimulatedModel::new(&image, &Array2::ones((3, 3)), config()).is_err());
        let bad = SimulatedModelConfig { own_error: f64::NAN, ..config() };
        let refused = SimulatedModel::new(&image, &depth, bad);
        assert!(matches!(refused, Err(Error::Config(at)) if at.field == "own-error"));
    }
}
