//! Theorems of Eq. 15.
use super::common::{Random, residuals};
use crate::{Residual, empirical_bayes};
use approx::assert_relative_eq;
use proptest::prelude::*;

proptest! {
    #[test]
    fn the_printed_estimate(residuals in residuals(1..60)) {
        let mean = residuals.iter().map(|r| r.delta.powi(2) - r.variance).sum::<f64>() / residuals.len() as f64;
        assert_relative_eq!(empirical_bayes(&residuals), mean.max(0.0), epsilon = 1e-15);
    }

    #[test]
    fn the_estimate_scales_with_the_square_of_the_unit(residuals in residuals(2..40), k in 0.01..100.0_f64) {
        let scaled: Vec<_> =
            residuals.iter().map(|r| Residual { delta: k * r.delta, variance: k * k * r.variance }).collect();
        let (one, other) = (empirical_bayes(&residuals), empirical_bayes(&scaled));
        assert_relative_eq!(other, k * k * one, max_relative = 1e-6, epsilon = 1e-12 * k * k);
    }
}

/// Mean over many seeded samples of Eq. 14, within four standard errors of the truth. The clamp biases Eq. 15 upwards,
/// so the truth is far enough from 0 that it never acts.
#[test]
fn unbiased_on_gaussian_samples() {
    let mut random = Random(17);
    let truth: f64 = 0.2;
    let (samples, pixels) = (600, 400);
    let estimates: Vec<f64> = (0..samples)
        .map(|_| {
            let residual = |_| {
                let variance = 10_f64.powf(-3.0 + 2.5 * random.uniform());
                Residual { delta: (truth + variance).sqrt() * random.normal(), variance }
            };
            let residuals: Vec<_> = (0..pixels).map(residual).collect();
            empirical_bayes(&residuals)
        })
        .collect();
    let mean = estimates.iter().sum::<f64>() / f64::from(samples);
    let spread = estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / f64::from(samples - 1);
    let error = (spread / f64::from(samples)).sqrt();
    assert!(error < 0.002 && (mean - truth).abs() < 4.0 * error, "{mean} +- {error}");
}

#[test]
fn no_residuals_and_zeros_give_zero() {
    assert_eq!(empirical_bayes(&[]), 0.0);
    assert_eq!(empirical_bayes(&[Residual::default(); 3]), 0.0);
    assert_eq!(empirical_bayes(&[Residual { delta: 0.5, variance: 0.0 }]), 0.25);
}
