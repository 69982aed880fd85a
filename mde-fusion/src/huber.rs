use crate::Residual;
use crate::root::increasing_root;

/// The cut \\(k\\) of Huber's estimates, in standard deviations: 95 % efficient for normal errors.
pub(crate) const CUT: f64 = 1.345;

/// \\(\mathrm E\\,\min(Z^2, k^2)\\) of a standard normal, to 12 digits.
const EXPECTED: f64 = 0.710_164_548_268_914_6;

/// A robust estimate of the prior's variance (Huber's proposal 2): the \\(s \ge 0\\) with
///
/// \\[ \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \min\left(\frac{\delta(x)^2}{s + a^2 (\sigma_r^2)^{\mathrm{agg}}(x)},\\; k^2\right)
/// = \mathrm E\\,\min(Z^2, k^2),\qquad Z \sim \mathcal N(0, 1), \\]
///
/// or 0 where the left side is smaller at \\(s = 0\\) already.
pub(crate) fn huber_variance(residuals: &[Residual]) -> f64 {
    let count = residuals.len() as f64;
    let largest = residuals.iter().map(|r| r.delta * r.delta).fold(0.0, f64::max);
    if largest <= 0.0 {
        return 0.0;
    }
    // EXPECTED/F - 1 is increasing in s and, for equal variances, a line up to the cut: Newton takes a few steps.
    let excess = |s: f64| {
        let (mut sum, mut slope) = (0.0, 0.0);
        for r in residuals.iter().filter(|r| r.delta != 0.0) {
            let total = s + r.variance;
            let z2 = r.delta * r.delta / total;
            if z2 < CUT * CUT {
                sum += z2;
                slope -= z2 / total;
            } else {
                sum += CUT * CUT;
            }
        }
        let (mean, slope) = (sum / count, slope / count);
        (EXPECTED / mean - 1.0, -EXPECTED * slope / (mean * mean))
    };
    increasing_root(excess, largest / EXPECTED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::normal::{density, distribution};

    #[test]
    fn the_expected_value_equals_its_closed_form() {
        let exact =
            1.0 - 2.0 * distribution(-CUT) - 2.0 * CUT * density(CUT) + 2.0 * CUT * CUT * distribution(-CUT);
        approx::assert_relative_eq!(EXPECTED, exact, max_relative = 1e-12);
    }
}
