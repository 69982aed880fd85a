//! The standard normal distribution: the error function (from [`libm`]) and its inverses.
//!
//! `libm` has no inverse, and the crates that have one bring a library of distributions with it; both inverses below are
//! Newton's method on `libm`'s functions, to the last few bits.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

/// \\(1 / \sqrt\pi\\).
pub const FRAC_1_SQRT_PI: f64 = 0.5 * FRAC_2_SQRT_PI;

/// Steps of Newton's method; it converges quadratically and from one side.
const STEPS: usize = 60;

/// \\(\operatorname{erf}(x) = \frac{2}{\sqrt\pi} \int_0^x e^{-t^2}\\,\mathrm d t\\), to one unit in the last place.
pub fn erf(x: f64) -> f64 {
    libm::erf(x)
}

/// The density \\(\varphi(x) = e^{-x^2/2} / \sqrt{2\pi}\\).
pub fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() * FRAC_1_SQRT_2 * FRAC_1_SQRT_PI
}

/// The distribution function \\(\Phi(x) = \tfrac12 \operatorname{erfc}(-x / \sqrt2)\\), to full relative precision in the lower tail.
pub fn distribution(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// The quantile \\(\Phi^{-1}(p)\\); infinite at 0 and 1, NaN outside of them.
///
/// ```
/// assert!((mde_uncertainty::normal::quantile(0.975) - 1.959_963_984_540_054).abs() < 1e-14);
/// ```
pub fn quantile(p: f64) -> f64 {
    match p {
        0.0 => f64::NEG_INFINITY,
        1.0 => f64::INFINITY,
        p if p > 0.0 && p <= 0.5 => lower_quantile(p),
        p if p > 0.5 && p < 1.0 => -lower_quantile(1.0 - p),
        _ => f64::NAN,
    }
}

/// Half the width of the central interval of probability `p`, in standard deviations: \\(\operatorname{erf}(z / \sqrt2) = p\\), that
/// is \\(z = \Phi^{-1}\\!\left(\tfrac{1 + p}{2}\right)\\). 0 for `p` = 0, infinite for 1, NaN outside of them.
///
/// ```
/// assert!((mde_uncertainty::normal::central_half_width(0.9) - 1.644_853_626_951_472_2).abs() < 1e-14);
/// ```
pub fn central_half_width(p: f64) -> f64 {
    if !(0.0..=1.0).contains(&p) {
        return f64::NAN;
    }
    if p >= 0.5 {
        return -quantile(0.5 * (1.0 - p));
    }
    // erf is concave here: its tangents lie above it, so each step ends short of the root.
    newton(0.0, |z| (p - erf(z * FRAC_1_SQRT_2)) / (2.0 * density(z)))
}

/// \\(\Phi^{-1}(p)\\) for `p` in \\((0, \tfrac12]\\).
fn lower_quantile(p: f64) -> f64 {
    // Below the smallest normal number \Phi loses its digits.
    let target = p.max(f64::MIN_POSITIVE);
    // \Phi(-x) <= e^{-x^2/2} / 2 starts beyond the root. ln \Phi is concave, so each step stays beyond it.
    newton(-(-2.0 * (2.0 * target).ln()).max(0.0).sqrt(), |x| {
        let reached = distribution(x);
        (target / reached).ln() * reached / density(x)
    })
}

/// Newton's method from below the root, until a step changes nothing.
fn newton(mut x: f64, step: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..STEPS {
        let by = step(x);
        if by <= 0.0 || x + by == x {
            break;
        }
        x += by;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::proptest::prelude::*;

    /// From mpmath, with 40 digits.
    #[test]
    fn quantiles_equal_scipys() {
        let reference = [
            (0.95, 1.644_853_626_951_472_2),
            (0.975, 1.959_963_984_540_054),
            (0.75, 0.674_489_750_196_081_7),
            (1e-10, -6.361_340_902_404_056),
            (1e-300, -37.047_096_299_361_2),
            (0.5, 0.0),
        ];
        for (p, expected) in reference {
            let found = quantile(p);
            assert!((found - expected).abs() <= 1e-14 * expected.abs().max(1.0), "{p}: {found}");
        }
        assert_eq!((quantile(0.0), quantile(1.0)), (f64::NEG_INFINITY, f64::INFINITY));
        let outside = [-0.1, 1.1, f64::NAN];
        assert!(outside.iter().all(|p| quantile(*p).is_nan() && central_half_width(*p).is_nan()));
        assert_eq!((central_half_width(0.0), central_half_width(1.0)), (0.0, f64::INFINITY));
    }

    proptest! {
        #[test]
        fn the_quantile_inverts_the_distribution_function(x in -37.0..0.0_f64, p in 1e-9..1.0_f64) {
            prop_assert!((quantile(distribution(x)) - x).abs() <= 2e-14 * (1.0 + x.abs()));
            prop_assert!((erf(central_half_width(p) * FRAC_1_SQRT_2) - p).abs() <= 4e-16);
        }
    }
}
