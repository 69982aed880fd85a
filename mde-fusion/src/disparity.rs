use crate::Gaussian;

/// Largest squared relative deviation that the mean correction follows; the series is meaningless beyond.
const MAX_RELATIVE_VARIANCE: f64 = 1.0;

/// Moments of \\(1/X\\) from those of \\(X\\), to second order: depth to disparity.
///
/// \\[ \mathrm E[1/X] \approx \frac1\mu (1 + r),\qquad \operatorname{Var}[1/X] \approx \frac{\sigma^2}{\mu^4},
/// \qquad r = \min\left(1, \frac{\sigma^2}{\mu^2}\right) \\]
///
/// `None` unless the mean is positive and the result finite.
pub fn to_disparity(depth: Gaussian) -> Option<Gaussian> {
    let Gaussian { mean, variance } = depth;
    if mean.is_nan() || mean <= 0.0 {
        return None;
    }
    let r = (variance / (mean * mean)).min(MAX_RELATIVE_VARIANCE);
    finite(Gaussian::new((1.0 + r) / mean, variance / mean.powi(4)))
}

/// The inverse of [`to_disparity`]: the depth whose disparity has these moments.
///
/// With \\(\rho = \sigma^2/\mu^2\\) of the disparity, \\(r\\) solves \\(\rho = r/(1+r)^2\\), and
///
/// \\[ \mathrm E[1/X] \approx \frac{1 + r}{\mu},\qquad r = \frac{1 - 2\rho - \sqrt{1 - 4\rho}}{2\rho}
/// = \rho + 2\rho^2 + \dots,\qquad \operatorname{Var}[1/X] \approx \sigma^2\\,\mathrm E[1/X]^4, \\]
///
/// \\(r = 1\\) from \\(\rho = 1/4\\) on. To first order this is the usual correction \\(\tfrac1\mu(1 + \rho)\\);
/// being the exact inverse, it returns a prior that the fusion left alone as it came.
///
/// `None` unless the mean is positive and the result finite.
pub fn to_depth(disparity: Gaussian) -> Option<Gaussian> {
    let Gaussian { mean, variance } = disparity;
    if mean.is_nan() || mean <= 0.0 {
        return None;
    }
    let rho = variance / (mean * mean);
    let r = if rho < 0.25 {
        // The smaller root of r^2 - (1/rho - 2) r + 1, in the form that does not cancel.
        2.0 * rho / (1.0 - 2.0 * rho + (1.0 - 4.0 * rho).sqrt())
    } else {
        MAX_RELATIVE_VARIANCE
    };
    let depth = (1.0 + r) / mean;
    finite(Gaussian::new(depth, variance * depth.powi(4)))
}

fn finite(g: Gaussian) -> Option<Gaussian> {
    (g.mean.is_finite() && g.variance.is_finite()).then_some(g)
}
