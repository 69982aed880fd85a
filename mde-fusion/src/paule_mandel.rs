use crate::Residual;
use crate::root::increasing_root;

/// Paule-Mandel estimate of the prior's variance: the \\(s \ge 0\\) at which the standardised residuals have
/// variance 1,
///
/// \\[ \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X} \frac{\delta(x)^2}{s + a^2 (\sigma_r^2)^{\mathrm{agg}}(x)} = 1, \\]
///
/// or 0 where even \\(s = 0\\) leaves them below 1. Unlike Eq. 15 it weighs a pixel by what it can say.
/// (Paule and Mandel, *Consensus values and weighting factors*, 1982, with the mean known.)
pub fn paule_mandel(residuals: &[Residual]) -> f64 {
    standardised_root(residuals, f64::INFINITY, 1.0)
}

/// [`paule_mandel`] with large residuals cut (Huber's proposal 2): the \\(s \ge 0\\) with
///
/// \\[ \frac{1}{|\mathcal X|} \sum_{x\in\mathcal X}
/// \min\left(\frac{\delta(x)^2}{s + a^2 (\sigma_r^2)^{\mathrm{agg}}(x)},\\; k^2\right)
/// = \mathrm E\\,\min(Z^2, k^2),\qquad Z \sim \mathcal N(0, 1), \\]
///
/// or 0 where \\(s = 0\\) is already enough. `k` is the cut in standard deviations, infinite for none; a cut that is
/// not positive counts as none.
pub fn huber_variance(residuals: &[Residual], k: f64) -> f64 {
    if k > 0.0 && k.is_finite() {
        standardised_root(residuals, k * k, truncated_second_moment(k))
    } else {
        paule_mandel(residuals)
    }
}

fn standardised_root(residuals: &[Residual], cut: f64, target: f64) -> f64 {
    let count = residuals.len() as f64;
    let largest = residuals.iter().map(|r| r.delta * r.delta).fold(0.0, f64::max);
    if largest <= 0.0 {
        return 0.0;
    }
    // 1 - target/F is increasing in s and, for equal variances, close to a line: Newton takes a few steps.
    let excess = |s: f64| {
        let (mut sum, mut slope) = (0.0, 0.0);
        for r in residuals.iter().filter(|r| r.delta != 0.0) {
            let total = s + r.variance;
            let z2 = r.delta * r.delta / total;
            if z2 < cut {
                sum += z2;
                slope -= z2 / total;
            } else {
                sum += cut;
            }
        }
        let (mean, slope) = (sum / count, slope / count);
        (target / mean - 1.0, -target * slope / (mean * mean))
    };
    increasing_root(excess, largest / target)
}

/// \\(\mathrm E \min(Z^2, k^2)\\) of a standard normal, by Simpson's rule.
fn truncated_second_moment(k: f64) -> f64 {
    const INTERVALS: usize = 512;
    // Beyond 12 standard deviations nothing is left to cut.
    let end = k.min(12.0);
    let step = end / INTERVALS as f64;
    let (mut mass, mut second) = (0.0, 0.0);
    for i in 0..=INTERVALS {
        let weight = match i {
            0 | INTERVALS => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        let z = i as f64 * step;
        let density = weight * (-0.5 * z * z).exp();
        mass += density;
        second += density * z * z;
    }
    let scale = 2.0 * step / 3.0 / std::f64::consts::TAU.sqrt();
    second * scale + k * k * (1.0 - mass * scale).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncated_moment_matches_its_closed_form() {
        // 2 Phi(k) - 1 - 2 k phi(k) + 2 k^2 (1 - Phi(k)), by scipy.stats.norm.
        for (k, value) in [(0.5, 0.1851283651467202), (1.345, 0.7101645482690486), (3.0, 0.9950072780344534)]
        {
            approx::assert_relative_eq!(truncated_second_moment(k), value, max_relative = 1e-9);
        }
        approx::assert_relative_eq!(truncated_second_moment(60.0), 1.0, max_relative = 1e-9);
    }
}
