//! The losses of a ray and their gradients with respect to its colour and its termination weights.

use crate::config::DepthLoss;
use crate::frustum::Frustum;
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered};

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

/// The depth loss with its weight at this step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthTerm {
    loss: DepthLoss,
    /// The decay's factor of the weight.
    fade: f64,
}

impl DepthTerm {
    /// The term at `progress` (0 at the first step, 1 at the last).
    pub(crate) fn at(loss: DepthLoss, progress: f64) -> Self {
        let decay = match loss {
            DepthLoss::None => 0.0,
            DepthLoss::Wasserstein { decay, .. } | DepthLoss::Distribution { decay, .. } => decay,
        };
        let fade = if decay > 0.0 { (1.0 - progress / decay).max(0.0) } else { 1.0 };
        Self { loss, fade }
    }
}

/// The loss of a rendered ray, averaged over `rays`; adds the weights' gradients to `h` and returns the colour's.
///
/// Colour: the mean squared error over the channels, \\(\tfrac13 \lVert C - \hat C \rVert^2\\).
pub(crate) fn ray_loss<T: Scalar>(
    target: &Target,
    rendered: &Rendered<T>,
    bins: &Bins<T>,
    frustum: &Frustum,
    term: DepthTerm,
    rays: f64,
    h: &mut [T],
) -> (RayLoss, [T; 3]) {
    let mut squared_error = 0.0;
    let d_colour = std::array::from_fn(|axis| {
        let error = rendered.colour[axis].to_f64() - target.colour[axis];
        squared_error += error * error / 3.0;
        T::from_f64(2.0 / 3.0 * error / rays)
    });
    let mut total = squared_error;
    if let DepthLoss::Distribution { weight, relative_sigma, .. } = term.loss {
        if term.fade > 0.0 && !target.depths.is_empty() {
            let mixture = Mixture::new(&target.depths, relative_sigma, frustum);
            total += mixture.distance(term.fade * weight, rendered, bins, rays, h);
        }
        return (RayLoss { squared_error, total }, d_colour);
    }
    let share = term.fade / target.depths.len().max(1) as f64;
    for &(depth, _) in &target.depths {
        total += match term.loss {
            DepthLoss::Wasserstein { weight, .. } if share > 0.0 => {
                wasserstein(depth, share * weight, rendered, bins, frustum, rays, h)
            }
            _ => 0.0,
        };
    }
    (RayLoss { squared_error, total }, d_colour)
}

/// A ray's hypotheses in disparity (0 at far, 1 at near): means, and scales of logistic distributions.
struct Mixture(Vec<(f64, f64)>);

impl Mixture {
    /// Lower bound of a scale, narrower than any bin: hypotheses of tiny variance are steps.
    const NARROWEST: f64 = 1e-6;

    fn new(depths: &[(f64, f64)], relative_sigma: f64, frustum: &Frustum) -> Self {
        let logistic = |&(depth, variance): &(f64, f64)| {
            let z = depth.clamp(frustum.near, frustum.far);
            let sigma = variance.sqrt().max(relative_sigma * depth);
            // The standard deviation of the logistic distribution of scale 1 is pi / sqrt 3.
            let scale = frustum.disparity_slope(z) * sigma * 3.0_f64.sqrt() / std::f64::consts::PI;
            (frustum.disparity(z), scale.max(Self::NARROWEST))
        };
        Self(depths.iter().map(logistic).collect())
    }

    /// Probability that the ray ends nearer than a disparity.
    fn nearer(&self, disparity: f64) -> f64 {
        let share = |&(mean, scale): &(f64, f64)| 1.0 / (1.0 + ((disparity - mean) / scale).exp());
        self.0.iter().map(share).sum::<f64>() / self.0.len() as f64
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
        let first = 1.0 - at(0);
        let mut loss = first.max(0.0) * self.nearer(1.0 - 0.5 * first);
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

/// The escaping share counts as ending at far.
fn wasserstein<T: Scalar>(
    depth: f64,
    weight: f64,
    rendered: &Rendered<T>,
    bins: &Bins<T>,
    frustum: &Frustum,
    rays: f64,
    h: &mut [T],
) -> f64 {
    let target = frustum.disparity(depth.clamp(frustum.near, frustum.far));
    let mut loss = rendered.escaped().to_f64() * target;
    let scale = T::from_f64(weight / rays);
    let narrow = T::from_f64(target);
    let mut sum = T::ZERO;
    for ((h, &disparity), &w) in h.iter_mut().zip(&bins.disparity).zip(&rendered.weights) {
        let distance = (disparity - narrow).abs();
        sum += w * distance;
        *h += scale * (distance - narrow);
    }
    loss += sum.to_f64();
    weight * loss
}
