//! Theorems of Eq. 15-17.
use super::common::{gaussian, normal};
use crate::posterior::nerf_weight;
use crate::{Gaussian, Residual, empirical_bayes, posterior, precision_weighted};
use approx::assert_relative_eq;
use mde_uncertainty::random::CounterRng;
use proptest::prelude::*;

proptest! {
    #[test]
    fn the_printed_form_is_the_same_number(prior in gaussian(), views in gaussian()) {
        let precision = 1.0 / prior.variance + 1.0 / views.variance;
        let mean = (prior.mean / prior.variance + views.mean / views.variance) / precision;
        let fused = posterior(prior, views);
        for expected in [Gaussian::new(mean, 1.0 / precision), precision_weighted(&[prior, views]).unwrap()] {
            assert_relative_eq!(fused.mean, expected.mean, max_relative = 1e-12);
            assert_relative_eq!(fused.variance, expected.variance, max_relative = 1e-12);
        }
    }

    #[test]
    fn the_mean_lies_between_and_the_variance_below_both(prior in gaussian(), views in gaussian()) {
        let fused = posterior(prior, views);
        prop_assert!(fused.mean >= prior.mean.min(views.mean) && fused.mean <= prior.mean.max(views.mean));
        prop_assert!(fused.variance <= prior.variance && fused.variance <= views.variance);
        let w = nerf_weight(prior.variance, views.variance);
        prop_assert!((0.0..=1.0).contains(&w));
    }

    #[test]
    fn an_exact_side_wins_and_the_prior_wins_a_draw(prior in gaussian(), views in gaussian()) {
        let exact = |g: Gaussian| Gaussian::new(g.mean, 0.0);
        prop_assert_eq!(posterior(exact(prior), views), exact(prior));
        prop_assert_eq!(posterior(prior, exact(views)), exact(views));
        prop_assert_eq!(posterior(exact(prior), exact(views)), exact(prior));
    }
}

/// An infinite variance is a missing pixel.
#[test]
fn a_missing_side_has_no_weight() {
    let [known, missing] = [Gaussian::new(3.0, 0.04), Gaussian::new(0.0, f64::INFINITY)];
    assert_eq!(posterior(known, missing), known);
    assert_eq!(posterior(missing, known), known);
    assert_eq!(posterior(known, Gaussian::new(5.0, f64::INFINITY)), known);
    assert_eq!(precision_weighted(&[missing, missing]), None);
    assert_eq!(precision_weighted(&[missing, known]), Some(known));
}

/// Mean over many seeded samples of Eq. 14, within four standard errors of the truth. The clamp biases Eq. 15 upwards,
/// so the truth is far enough from 0 that it never acts.
#[test]
fn unbiased_on_gaussian_samples() {
    let mut rng = CounterRng::new(17, "fusion-test", 0, 0);
    let truth: f64 = 0.2;
    let (samples, pixels) = (600, 400);
    let estimates: Vec<f64> = (0..samples)
        .map(|_| {
            let residual = |_| {
                let variance = 10_f64.powf(rng.random_range(-3.0..-0.5));
                Residual { delta: (truth + variance).sqrt() * normal(&mut rng), variance }
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
