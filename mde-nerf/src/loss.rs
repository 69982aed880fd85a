//! The losses of a ray and their gradients with respect to its colour and its termination weights.

use crate::config::{ColourLoss, TrainConfig};
use crate::frustum::Interval;
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered};
use std::ops::AddAssign;

/// Supervision of a ray.
#[derive(Debug, Clone, Default)]
pub(crate) struct Target {
    pub(crate) colour: [f64; 3],
    /// Depth hypotheses along this ray and their variances.
    pub(crate) depths: Vec<(f64, f64)>,
}

/// A ray's squared colour error (mean over channels) and its whole loss.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RayLoss {
    pub(crate) squared_error: f64,
    pub(crate) total: f64,
}

impl AddAssign for RayLoss {
    fn add_assign(&mut self, other: Self) {
        self.squared_error += other.squared_error;
        self.total += other.total;
    }
}

/// \\(\delta\\) of [`ColourLoss::Charbonnier`], colours in 0 to 1.
const DELTA: f64 = 0.1;
/// Weight of [`ColourLoss::Charbonnier`] at the last step.
const FINAL_WEIGHT: f64 = 6.0;
/// Lower bound of the standard deviation of a hypothesis, as a fraction of its depth: those of variance 0 are exact, and the
/// termination cannot be.
const RELATIVE_SIGMA: f64 = 0.005;
/// Fractions of the steps between which the weight of the hypotheses falls, and what is left of it.
const FADE: [f64; 2] = [0.2, 0.8];
const LEFT: f64 = 0.02;

/// The losses with their weights at a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LossTerms {
    colour: ColourLoss,
    /// Weight of a [`ColourLoss::Charbonnier`].
    colour_weight: f64,
    depth_weight: f64,
}

impl LossTerms {
    /// The terms at `progress` (0 at the first step, 1 at the last).
    pub(crate) fn at(config: &TrainConfig, progress: f64) -> Self {
        Self {
            colour: config.colour_loss,
            colour_weight: 1.0 + (FINAL_WEIGHT - 1.0) * progress,
            depth_weight: fade(progress) * config.depth_weight,
        }
    }
}

fn fade(progress: f64) -> f64 {
    let [start, end] = FADE;
    if progress <= start {
        1.0
    } else if progress >= end {
        LEFT
    } else {
        1.0 + (LEFT - 1.0) * (progress - start) / (end - start)
    }
}

/// The loss of a rendered ray, averaged over `rays`; adds the weights' gradients to `h` and returns the colour's.
pub(crate) fn ray_loss<T: Scalar>(
    target: &Target,
    rendered: &Rendered<T>,
    bins: &Bins<T>,
    interval: &Interval,
    terms: LossTerms,
    rays: f64,
    h: &mut [T],
) -> (RayLoss, [T; 3]) {
    let mut squared_error = 0.0;
    let mut colour_loss = 0.0;
    let d_colour = std::array::from_fn(|axis| {
        let error = rendered.colour[axis].to_f64() - target.colour[axis];
        squared_error += error * error / 3.0;
        match terms.colour {
            ColourLoss::Squared => T::from_f64(2.0 / 3.0 * error / rays),
            ColourLoss::Charbonnier => {
                let root = (1.0 + (error / DELTA).powi(2)).sqrt();
                // Without the cancellation of root - 1.
                colour_loss += terms.colour_weight * 2.0 / 3.0 * error * error / (1.0 + root);
                T::from_f64(terms.colour_weight * 2.0 / 3.0 * error / root / rays)
            }
        }
    });
    let mut total = if terms.colour == ColourLoss::Squared { squared_error } else { colour_loss };
    if terms.depth_weight > 0.0 && !target.depths.is_empty() {
        let mixture = Mixture::new(&target.depths, interval);
        total += mixture.distance(terms.depth_weight, rendered, bins, rays, h);
    }
    (RayLoss { squared_error, total }, d_colour)
}

/// A ray's hypotheses in disparity: means, and scales of logistic distributions.
struct Mixture {
    logistics: Vec<(f64, f64)>,
    /// Disparity at the near end of the ray.
    largest: f64,
}

impl Mixture {
    /// Lower bound of a scale, narrower than any bin: hypotheses of tiny variance are steps.
    const NARROWEST: f64 = 1e-6;

    fn new(depths: &[(f64, f64)], interval: &Interval) -> Self {
        let logistic = |&(depth, variance): &(f64, f64)| {
            let z = depth.clamp(interval.near, interval.far);
            let sigma = variance.sqrt().max(RELATIVE_SIGMA * depth);
            // The standard deviation of the logistic distribution of scale 1 is pi / sqrt 3.
            let scale = interval.disparity_slope(z) * sigma * 3.0_f64.sqrt() / std::f64::consts::PI;
            (interval.disparity(z), scale.max(Self::NARROWEST))
        };
        Self { logistics: depths.iter().map(logistic).collect(), largest: interval.largest_disparity() }
    }

    /// Probability that the ray ends nearer than a disparity.
    fn nearer(&self, disparity: f64) -> f64 {
        let share = |&(mean, scale): &(f64, f64)| 1.0 / (1.0 + ((disparity - mean) / scale).exp());
        self.logistics.iter().map(share).sum::<f64>() / self.logistics.len() as f64
    }

    /// The distance between the distribution functions by the midpoint rule on the intervals between samples; the escaping
    /// share ends at far.
    fn distance<T: Scalar>(
        &self,
        weight: f64,
        rendered: &Rendered<T>,
        bins: &Bins<T>,
        rays: f64,
        h: &mut [T],
    ) -> f64 {
        let at = |index: usize| bins.disparity.get(index).map_or(0.0, |d| d.to_f64());
        let first = self.largest - at(0);
        let mut loss = first.max(0.0) * self.nearer(self.largest - 0.5 * first);
        let mut ended = 0.0;
        // A sample's weight raises the distribution function from there to far.
        let slopes: Vec<f64> = (0..rendered.weights.len())
            .map(|index| {
                ended += rendered.weights[index].to_f64();
                let (width, middle) = (at(index) - at(index + 1), 0.5 * (at(index) + at(index + 1)));
                let excess = ended - self.nearer(middle);
                loss += excess.abs() * width;
                excess.signum() * width
            })
            .collect();
        let mut slope = 0.0;
        for (h, s) in h.iter_mut().zip(&slopes).rev() {
            slope += s;
            *h += T::from_f64(weight * slope / rays);
        }
        weight * loss
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_of_the_hypotheses_falls_linearly_between_a_fifth_and_four_fifths() {
        for (progress, weight) in [(0.0, 1.0), (0.2, 1.0), (0.5, 0.51), (0.8, 0.02), (1.0, 0.02)] {
            assert!((fade(progress) - weight).abs() < 1e-12, "{progress}: {}", fade(progress));
        }
    }
}
