//! The losses of a ray and their gradients with respect to its colour and its termination weights.

use crate::config::DepthLoss;
use crate::frustum::Frustum;
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered, moment_slopes};

/// Added to the variance inside the Gaussian likelihood, in units of the squared median depth.
const NLL_FLOOR: f64 = 1e-5;

/// What a ray should look like.
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
    /// Share of the weight that the decay leaves.
    fade: f64,
}

impl DepthTerm {
    /// The term at `progress` (0 at the first step, 1 at the last).
    pub(crate) fn at(loss: DepthLoss, progress: f64) -> Self {
        let decay = match loss {
            DepthLoss::None => 0.0,
            DepthLoss::GaussianNll { decay, .. } | DepthLoss::Wasserstein { decay, .. } => decay,
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
    let share = term.fade / target.depths.len().max(1) as f64;
    for &(depth, variance) in &target.depths {
        total += match term.loss {
            DepthLoss::None => 0.0,
            _ if share == 0.0 => 0.0,
            DepthLoss::GaussianNll { weight, relative_sigma, .. } => {
                let sigma = if variance > 0.0 { variance.sqrt() } else { relative_sigma * depth };
                gaussian_nll(depth, sigma, share * weight, rendered, bins, frustum.unit, rays, h)
            }
            DepthLoss::Wasserstein { weight, .. } => {
                wasserstein(depth, share * weight, rendered, bins, frustum, rays, h)
            }
        };
    }
    (RayLoss { squared_error, total }, d_colour)
}

#[allow(clippy::too_many_arguments, reason = "one formula, called from one place")]
fn gaussian_nll<T: Scalar>(
    depth: f64,
    sigma: f64,
    weight: f64,
    rendered: &Rendered<T>,
    bins: &Bins<T>,
    unit: f64,
    rays: f64,
    h: &mut [T],
) -> f64 {
    let moments = &rendered.depth;
    if moments.opacity.to_f64() < 1e-3 {
        return 0.0;
    }
    let error = (moments.mean.to_f64() - depth) / unit;
    let variance = moments.variance.to_f64() / (unit * unit);
    let sigma = sigma / unit;
    if error.abs() <= sigma && variance <= sigma * sigma {
        return 0.0;
    }
    let spread = variance + NLL_FLOOR;
    let d_mean = T::from_f64(weight * error / spread / unit / rays);
    let d_variance =
        T::from_f64(0.5 * weight * (1.0 - error * error / spread) / spread / (unit * unit) / rays);
    for (h, &t) in h.iter_mut().zip(&bins.depth) {
        let (mean, variance) = moment_slopes(moments, t);
        *h += d_mean * mean + d_variance * variance;
    }
    0.5 * weight * (spread.ln() + error * error / spread)
}

/// What escapes the volume counts as ending at far.
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
