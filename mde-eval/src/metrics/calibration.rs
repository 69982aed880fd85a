//! Size of the uncertainty against the errors. Each pixel predicts a Gaussian with standard deviation \\(s_i\\), and its
//! error \\(e_i\\) is prediction minus truth, in the same unit; \\(z_i = e_i / s_i\\).
//!
//! # Errors
//! All functions here: [`Error::Length`](crate::Error::Length) where the lists differ, [`Error::Empty`](crate::Error::Empty) without
//! pixels, [`Error::Value`](crate::Error::Value) for an error that is not finite or a sigma that is not positive and finite.

use super::sparsification::expected;
use crate::Result;
use crate::error::{self, check_lists, positive};
use mde_uncertainty::normal::{FRAC_1_SQRT_PI, density, erf};
use mde_uncertainty::statistics::Order;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Negative log-likelihood of the truth, in nats per pixel:
///
/// \\[ \frac1n \sum_i \tfrac12 \ln(2\pi s_i^2) + \frac{e_i^2}{2 s_i^2} \\]
pub fn nll(errors: &[f64], sigma: &[f64]) -> Result<f64> {
    mean(errors, sigma, |e, s| 0.5 * (2.0 * PI).ln() + s.ln() + 0.5 * (e / s).powi(2))
}

/// Continuous ranked probability score of a Gaussian, in the unit of the errors (Gneiting and Raftery, 2007):
///
/// \\[ \frac1n \sum_i s_i \left( z_i (2\Phi(z_i) - 1) + 2\varphi(z_i) - \frac{1}{\sqrt\pi} \right) \\]
pub fn crps(errors: &[f64], sigma: &[f64]) -> Result<f64> {
    mean(errors, sigma, |e, s| {
        let z = e / s;
        s * (z * erf(z * FRAC_1_SQRT_2) + 2.0 * density(z) - FRAC_1_SQRT_PI)
    })
}

/// Share of the truths within the central interval of probability `level`, in 0 to 1: nominal is `level` itself.
///
/// \\[ \frac1n \left|\left\\{i : \operatorname{erf}\left(|z_i| / \sqrt2\right) \le p\right\\}\right| \\]
pub fn coverage(errors: &[f64], sigma: &[f64], level: f64) -> Result<f64> {
    mean(errors, sigma, |e, s| f64::from(u8::from(central_probability(e, s) <= level)))
}

/// Mean of \\(z_i^2\\): 1 where the sigmas are right on average, above 1 where they are too small, below 1 where too large.
pub fn mean_z2(errors: &[f64], sigma: &[f64]) -> Result<f64> {
    mean(errors, sigma, |e, s| (e / s).powi(2))
}

/// Root of the mean variance, \\(\sqrt{\frac1n \sum_i s_i^2}\\): the sharpness of the predicted distribution.
pub fn rms_sigma(errors: &[f64], sigma: &[f64]) -> Result<f64> {
    Ok(mean(errors, sigma, |_, s| s * s)?.sqrt())
}

/// Nominal and observed coverage of central intervals at 0, 1/99, ..., 1 (the reliability curve).
pub fn reliability(errors: &[f64], sigma: &[f64]) -> Result<Vec<(f64, f64)>> {
    const STEPS: usize = 99;
    check(errors, sigma)?;
    let mut inside: Vec<f64> = errors.iter().zip(sigma).map(|(&e, &s)| central_probability(e, s)).collect();
    inside.sort_unstable_by(f64::total_cmp);
    let point = |k: usize| {
        let nominal = k as f64 / STEPS as f64;
        (nominal, inside.partition_point(|p| *p <= nominal) as f64 / inside.len() as f64)
    };
    Ok((0..=STEPS).map(point).collect())
}

/// Expected normalised calibration error (Levi et al., "Evaluating and calibrating uncertainty prediction in regression tasks",
/// 2019) over `bins` runs of equal size in order of sigma, ties averaged:
///
/// \\[ \frac1B \sum_b \frac{|\mathrm{RMV}_b - \mathrm{RMSE}_b|}{\mathrm{RMV}_b},\qquad
///     \mathrm{RMV}_b^2 = \operatorname{mean}_b s^2,\quad \mathrm{RMSE}_b^2 = \operatorname{mean}_b e^2 \\]
pub fn ence(errors: &[f64], sigma: &[f64], bins: usize) -> Result<f64> {
    check(errors, sigma)?;
    error::check([("the number of ENCE bins", bins as f64, bins > 0, "use at least 1")])?;
    let square = |values: &[f64]| values.iter().map(|v| v * v).collect::<Vec<_>>();
    let order = Order::new(sigma)?;
    let [squares, variances] = [errors, sigma].map(|values| expected(&order, &square(values)));
    let (n, bins) = (errors.len(), bins.min(errors.len()));
    let root_mean = |values: &[f64]| (values.iter().sum::<f64>() / values.len() as f64).sqrt();
    let total: f64 = (0..bins)
        .map(|k| k * n / bins..(k + 1) * n / bins)
        .map(|run| (root_mean(&variances[run.clone()]), root_mean(&squares[run])))
        .map(|(expected, observed)| (expected - observed).abs() / expected)
        .sum();
    Ok(total / bins as f64)
}

/// Probability of the smallest central interval that holds the truth: \\(\operatorname{erf}(|z| / \sqrt 2)\\).
fn central_probability(error: f64, sigma: f64) -> f64 {
    erf((error / sigma).abs() * FRAC_1_SQRT_2)
}

fn mean(errors: &[f64], sigma: &[f64], term: impl Fn(f64, f64) -> f64) -> Result<f64> {
    check(errors, sigma)?;
    Ok(errors.iter().zip(sigma).map(|(&e, &s)| term(e, s)).sum::<f64>() / errors.len() as f64)
}

fn check(errors: &[f64], sigma: &[f64]) -> Result<()> {
    check_lists(
        "the calibration",
        [("the error", errors, f64::is_finite, "finite"), positive("sigma", sigma)],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn reliability_is_coverage(pixels in proptest::collection::vec((-3.0..3.0_f64, 0.1..2.0_f64), 1..80)) {
            let (errors, sigma): (Vec<f64>, Vec<f64>) = pixels.into_iter().unzip();
            for (nominal, observed) in reliability(&errors, &sigma).unwrap() {
                prop_assert!((coverage(&errors, &sigma, nominal).unwrap() - observed).abs() < 1e-12);
            }
        }
    }
}
