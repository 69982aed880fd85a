//! Theorems of Eq. 15.
use super::common::Random;
use crate::{Residual, empirical_bayes};

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
