//! The losses of a ray and their gradients with respect to its colour and its termination weights.

use crate::config::DepthLoss;
use crate::frustum::Frustum;
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered, moment_slopes};

/// Added to the variance inside the Gaussian likelihood, in units of the squared median depth.
const NLL_FLOOR: f64 = 1e-5;

/// A ray that hardly ends has no mean depth to speak of.
const LEAST_OPACITY: f64 = 1e-3;

/// What a ray should look like.
#[derive(Debug, Clone, Default)]
pub(crate) struct Target {
    pub(crate) colour: [f64; 3],
    /// Depth hypotheses along this ray and their variances.
    pub(crate) depths: Vec<(f64, f64)>,
    /// How much its depth should be that of the ray before it; 0 where they have nothing to do with each other.
    pub(crate) alike: f64,
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
            DepthLoss::GaussianNll { decay, .. }
            | DepthLoss::Wasserstein { decay, .. }
            | DepthLoss::Distribution { decay, .. } => decay,
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
    for &(depth, variance) in &target.depths {
        total += match term.loss {
            DepthLoss::None | DepthLoss::Distribution { .. } => 0.0,
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

/// The smoothness of neighbouring rays, averaged over `rays`: the loss, and its slope in each ray's mean depth.
pub(crate) fn smoothness<T: Scalar>(
    targets: &[Target],
    rendered: &[Rendered<T>],
    rays: f64,
    slopes: &mut Vec<f64>,
) -> f64 {
    slopes.clear();
    slopes.resize(targets.len(), 0.0);
    let mut total = 0.0;
    for (index, target) in targets.iter().enumerate().skip(1).filter(|(_, target)| target.alike > 0.0) {
        let [before, this] = [index - 1, index].map(|i| &rendered[i].depth);
        if before.opacity.to_f64().min(this.opacity.to_f64()) < LEAST_OPACITY {
            continue;
        }
        let [before, this] = [before, this].map(|moments| moments.mean.to_f64());
        let difference = (this / before).ln();
        total += target.alike * difference.abs();
        slopes[index] += target.alike * difference.signum() / this / rays;
        slopes[index - 1] -= target.alike * difference.signum() / before / rays;
    }
    total
}

/// Adds the gradients of a ray's weights, given the loss's slope in its mean depth.
pub(crate) fn add_mean_slope<T: Scalar>(slope: f64, rendered: &Rendered<T>, bins: &Bins<T>, h: &mut [T]) {
    let slope = T::from_f64(slope);
    for (h, &t) in h.iter_mut().zip(&bins.depth) {
        *h += slope * moment_slopes(&rendered.depth, t).0;
    }
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
    if moments.opacity.to_f64() < LEAST_OPACITY {
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

/// A ray's hypotheses in disparity (0 at far, 1 at near): means, and scales of logistic distributions.
struct Mixture(Vec<(f64, f64)>);

impl Mixture {
    /// Narrower than any bin: a hypothesis that is certain is a step.
    const NARROWEST: f64 = 1e-6;

    fn new(depths: &[(f64, f64)], relative_sigma: f64, frustum: &Frustum) -> Self {
        let logistic = |&(depth, variance): &(f64, f64)| {
            let z = depth.clamp(frustum.near, frustum.far);
            let sigma = if variance > 0.0 { variance.sqrt() } else { relative_sigma * depth };
            // The standard deviation of the logistic distribution of scale 1 is pi / sqrt 3.
            let scale = frustum.disparity_slope(z) * sigma * 3.0_f64.sqrt() / std::f64::consts::PI;
            (frustum.disparity(z), scale.max(Self::NARROWEST))
        };
        Self(depths.iter().map(logistic).collect())
    }

    /// How probable an end nearer than a disparity is.
    fn nearer(&self, disparity: f64) -> f64 {
        let share = |&(mean, scale): &(f64, f64)| 1.0 / (1.0 + ((disparity - mean) / scale).exp());
        self.0.iter().map(share).sum::<f64>() / self.0.len() as f64
    }

    /// The distance between the distribution functions, each interval between two samples by its middle; what escapes the
    /// volume ends at far.
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
