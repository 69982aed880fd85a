//! Size of the uncertainty against the errors. Each pixel predicts a Gaussian with standard deviation \\(s_i\\), and its
//! error \\(e_i\\) is prediction minus truth, in the same unit; \\(z_i = e_i / s_i\\).
//!
//! # Errors
//! All functions here: [`Error::Length`](crate::Error::Length) where the lists differ, [`Error::Empty`](crate::Error::Empty) without
//! pixels, [`Error::Value`](crate::Error::Value) for an error that is not finite or a sigma that is not positive and finite.

use crate::Result;
use crate::error::{check_lists, positive};
use mde_uncertainty::normal::{FRAC_1_SQRT_PI, density, erf};
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
