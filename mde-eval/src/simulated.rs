//! Predictions made from the truth, with the faults of monocular networks: of a depth map, and by a model that accepts crops.

mod model;

pub use model::{SimulatedModel, SimulatedModelConfig};

use crate::Result;
use crate::error::check;
use crate::raster::{blur_known, smallest};
use mde_prior::{DepthKind, PriorDepth};
use mde_uncertainty::filter::Gaussian;
use mde_uncertainty::random::CounterRng;
use ndarray::{Array2, Zip};
use rand::RngExt;
use std::f64::consts::TAU;

/// Faults of a [`simulated_prior`].
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedPriorConfig {
    /// Kind of the predicted values: [`DepthKind::AffineDisparity`], or else metres.
    pub kind: DepthKind,
    /// Things in front of a background that are narrower than this vanish, as a fraction of the image's width.
    pub lost_width: f64,
    /// Standard deviation of the Gaussian that softens the disparity, as a fraction of the image's width.
    pub blur: f64,
    /// Standard deviation over the image of the logarithm of the low-frequency error.
    pub error: f64,
    /// Seed of the low-frequency error.
    pub seed: u64,
}

impl Default for SimulatedPriorConfig {
    /// A weak network's faults at its usual input of about 400 pixels, in metres.
    fn default() -> Self {
        Self { kind: DepthKind::Metric, lost_width: 0.012, blur: 0.006, error: 0.05, seed: 0 }
    }
}

impl SimulatedPriorConfig {
    /// The same faults in a disparity of unknown scale and shift.
    #[must_use]
    pub fn disparity() -> Self {
        Self { kind: DepthKind::AffineDisparity, ..Self::default() }
    }

    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) names the field and what it must be.
    pub fn validate(&self) -> Result<()> {
        let share = |value: f64| (0.0..=0.25).contains(&value);
        check([
            ("lost-width", self.lost_width, share(self.lost_width), "use 0 to 0.25 of the width"),
            ("blur", self.blur, share(self.blur), "use 0 to 0.25 of the width"),
            ("error", self.error, (0.0..=1.0).contains(&self.error), "use 0 to 1"),
        ])
    }
}

/// Shortest wavelength of a low-frequency error, as a fraction of the width of what it bends.
const WAVELENGTH: f64 = 0.4;
/// Gain of a disparity, and what is added to it, in units of its median.
const DISPARITY: (f64, f64) = (700.0, -0.3);

/// A prediction for an image whose true depth \\(z\\), `[height, width]`, is known: thin things lost, edges soft, bent at low frequencies.
/// Missing pixels (not positive or not finite) stay missing.
///
/// \\[ \hat z = e^{\epsilon f} \Big/ \Bigl(G_\sigma * \frac{1}{\operatorname{close}_r z}\Bigr) \\]
///
/// with \\(\operatorname{close}_r\\) the grey closing by a square (what is nearer than its surroundings and narrow takes
/// their depth), \\(G_\sigma\\) a Gaussian and \\(f\\) a sum of long waves of mean 0 and variance 1 over the image. The
/// prediction is \\(\hat z\\), or \\(s/\hat z + t\\) as a disparity.
///
/// # Errors
/// [`Error::Config`](crate::Error::Config); [`Error::Prior`](crate::Error::Prior) for a map without any depth.
pub fn simulated_prior(truth: &Array2<f32>, config: &SimulatedPriorConfig) -> Result<PriorDepth> {
    config.validate()?;
    let valid = truth.mapv(|z| z > 0.0 && z.is_finite());
    let width = truth.ncols() as f64;
    let radius = (0.5 * config.lost_width * width).round() as usize;
    let known = Zip::from(truth).and(&valid).map_collect(|&z, &valid| if valid { f64::from(z) } else { 0.0 });
    let closed = close(&known, radius).mapv(|z| if z > 0.0 { z.recip() } else { 0.0 });
    let weights = valid.mapv(|valid| f64::from(u8::from(valid)));
    let disparity = blur_known(&closed, &weights, Gaussian::new(config.blur * width, 4.0));
    let waves = waves(truth.dim(), ("simulated-prior", config.seed, 0));
    let depth = Zip::from(&disparity)
        .and(&waves)
        .and(&valid)
        .map_collect(|&d, &f, &valid| if valid { (config.error * f).exp() / d } else { 0.0 });
    let map = match config.kind {
        DepthKind::AffineDisparity => {
            let disparities = depth.iter().filter(|&&z| z > 0.0).map(|z| z.recip());
            let middle = mde_uncertainty::statistics::median(disparities).unwrap_or(1.0);
            let (scale, shift) = DISPARITY;
            depth.mapv(|z| if z > 0.0 { scale * (z.recip() + shift * middle) } else { 0.0 })
        }
        _ => depth,
    };
    Ok(PriorDepth::with_mask(map.mapv(|v| v as f32), valid, config.kind)?)
}

/// Grey closing by a square of side \\(2r + 1\\): the largest depth around, then the smallest of those; 0 is missing.
fn close(known: &Array2<f64>, radius: usize) -> Array2<f64> {
    let grown = smallest(known.mapv(|z| -z), radius);
    let closed = smallest(-grown, radius);
    // Next to missing pixels nothing may become missing.
    Zip::from(&closed).and(known).map_collect(|&closed, &z| if z > 0.0 { closed.max(z) } else { 0.0 })
}

/// A sum of waves no shorter than [`WAVELENGTH`], of mean 0 and variance 1 over the map, drawn from a purpose, a seed and an iteration.
fn waves((height, width): (usize, usize), (purpose, seed, iteration): (&str, u64, u64)) -> Array2<f64> {
    const COUNT: u64 = 12;
    let mut field = Array2::<f64>::zeros((height, width));
    let shortest = WAVELENGTH * width as f64;
    for index in 0..COUNT {
        let mut rng = CounterRng::new(seed, purpose, iteration, index);
        let mut draw = || rng.random::<f64>();
        // Uniform over the disc of frequencies, so that no length below the shortest is favoured.
        let (angle, frequency, phase) = (TAU * draw(), draw().sqrt() / shortest, TAU * draw());
        let (along_x, along_y) = (TAU * frequency * angle.cos(), TAU * frequency * angle.sin());
        field
            .indexed_iter_mut()
            .for_each(|((y, x), f)| *f += (along_x * x as f64 + along_y * y as f64 + phase).cos());
    }
    let mean = field.mean().unwrap_or(0.0);
    field -= mean;
    let spread = field.mapv(|f| f * f).mean().unwrap_or(0.0).sqrt();
    if spread > 1e-9 { field / spread } else { field }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    /// A wall at 3 m with a pole, three pixels wide, and a cupboard in front.
    fn truth() -> Array2<f32> {
        Array2::from_shape_fn((60, 80), |(_, x)| match x {
            20..23 => 1.0,
            50.. => 2.0,
            _ => 3.0,
        })
    }

    fn config() -> SimulatedPriorConfig {
        SimulatedPriorConfig { lost_width: 0.05, blur: 0.0, error: 0.0, ..SimulatedPriorConfig::default() }
    }

    fn made(config: &SimulatedPriorConfig) -> Array2<f32> {
        simulated_prior(&truth(), config).unwrap().map
    }

    #[test]
    fn without_faults_it_is_the_truth_and_else_thin_things_vanish() {
        let without_pole = truth().mapv(|z| if z == 1.0 { 3.0 } else { z });
        for (lost_width, expected) in [(0.0, truth()), (0.05, without_pole)] {
            let made = made(&SimulatedPriorConfig { lost_width, ..config() });
            assert!(made.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{lost_width}");
        }
    }

    #[test]
    fn edges_soften_and_flat_parts_stay() {
        let soft = made(&SimulatedPriorConfig { blur: 0.03, ..config() });
        assert!((soft[(30, 5)] - 3.0).abs() < 1e-5 && (soft[(30, 75)] - 2.0).abs() < 1e-5);
        assert!(soft[(30, 49)] > 2.2 && soft[(30, 49)] < 2.8);
    }

    #[test]
    fn the_error_has_its_size_and_is_seeded() {
        let bent = |seed| made(&SimulatedPriorConfig { lost_width: 0.0, error: 0.08, seed, ..config() });
        let logs = bent(3).iter().zip(&truth()).map(|(a, b)| f64::from(a / b).ln()).collect::<Vec<_>>();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        let spread = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / logs.len() as f64;
        assert!(mean.abs() < 1e-6 && (spread.sqrt() - 0.08).abs() < 1e-6, "{mean} {spread}");
        assert_eq!(bent(3), bent(3));
        assert_ne!(bent(3), bent(4));
    }

    #[test]
    fn a_disparity_is_affine_in_one_over_depth() {
        let kind = DepthKind::AffineDisparity;
        let map = made(&SimulatedPriorConfig { kind, lost_width: 0.0, ..config() });
        // Median depth 3: values 700 (1/z - 0.1).
        for (d, z) in map.iter().zip(&truth()) {
            assert!((f64::from(*d) / 70.0 - 10.0 * (1.0 / f64::from(*z) - 0.1)).abs() < 1e-4);
        }
    }

    #[test]
    fn missing_pixels_stay_missing() {
        let mut holes = truth();
        holes.row_mut(10).fill(0.0);
        holes[(0, 0)] = f32::NAN;
        let prior = simulated_prior(&holes, &SimulatedPriorConfig::default()).unwrap();
        assert!(prior.map.iter().zip(&holes).all(|(p, z)| (*p > 0.0) == (*z > 0.0)));
        assert!(simulated_prior(&Array2::zeros((4, 4)), &config()).is_err());
        let bad = SimulatedPriorConfig { blur: f64::NAN, ..config() };
        assert!(matches!(simulated_prior(&holes, &bad), Err(Error::Config(at)) if at.field == "blur"));
    }
}
