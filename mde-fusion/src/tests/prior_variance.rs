//! Theorems of Eq. 15 and of its alternatives.
use super::common::Random;
use crate::empirical_bayes::prior_variance_moments;
use crate::heteroscedastic::{Heteroscedastic, squared_gradient};
use crate::huber::{CUT, huber_variance};
use crate::nnls::nnls3;
use crate::proptest::residuals;
use crate::{Residual, empirical_bayes};
use ::proptest::prelude::*;
use approx::assert_relative_eq;
use mde_uncertainty::normal::{density, distribution};
use ndarray::{Array2, array};

type Estimator = fn(&[Residual]) -> f64;
const ESTIMATORS: [Estimator; 2] = [empirical_bayes, huber_variance];

proptest! {
    #[test]
    fn the_printed_estimate(residuals in residuals(1..60)) {
        let mean = residuals.iter().map(|r| r.delta.powi(2) - r.variance).sum::<f64>() / residuals.len() as f64;
        assert_relative_eq!(empirical_bayes(&residuals), mean.max(0.0), epsilon = 1e-15);
    }

    #[test]
    fn hubers_estimate_solves_its_equation(residuals in residuals(1..60)) {
        let s = huber_variance(&residuals);
        let term = |r: &Residual| (r.delta.powi(2) / (s + r.variance)).min(CUT * CUT);
        let mean = residuals.iter().map(term).sum::<f64>() / residuals.len() as f64;
        let expected = 1.0 - 2.0 * CUT * density(CUT) + 2.0 * (CUT * CUT - 1.0) * distribution(-CUT);
        if s > 0.0 {
            assert_relative_eq!(mean, expected, max_relative = 1e-9);
        } else {
            prop_assert!(mean <= expected * (1.0 + 1e-9));
        }
    }

    #[test]
    fn every_estimate_scales_with_the_square_of_the_unit(residuals in residuals(2..40), k in 0.01..100.0_f64) {
        let scaled: Vec<_> =
            residuals.iter().map(|r| Residual { delta: k * r.delta, variance: k * k * r.variance }).collect();
        for estimate in ESTIMATORS {
            let (one, other) = (estimate(&residuals), estimate(&scaled));
            assert_relative_eq!(other, k * k * one, max_relative = 1e-6, epsilon = 1e-12 * k * k);
        }
    }

    #[test]
    fn non_negative_least_squares_meets_the_optimality_conditions(
        rows in prop::collection::vec([-1.0..1.0_f64, -30.0..30.0, -0.01..0.01], 3..12),
        y in prop::collection::vec(-1.0..1.0_f64, 12),
    ) {
        let mut gram = [[0.0; 3]; 3];
        let mut rhs = [0.0; 3];
        for (row, y) in rows.iter().zip(&y) {
            for i in 0..3 {
                rhs[i] += row[i] * y;
                for j in 0..3 {
                    gram[i][j] += row[i] * row[j];
                }
            }
        }
        let c = nnls3(&gram, rhs);
        for i in 0..3 {
            let slope: f64 = (0..3).map(|j| gram[i][j] * c[j]).sum::<f64>() - rhs[i];
            let size = gram[i][i].sqrt() * 4.0;
            prop_assert!(c[i] >= 0.0);
            prop_assert!(slope >= -1e-7 * size, "going up in {i} would help: {slope}");
            prop_assert!(c[i] == 0.0 || slope.abs() <= 1e-7 * size, "{i} is free but has slope {slope}");
        }
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
            assert_eq!(empirical_bayes(&residuals), prior_variance_moments(&residuals));
            empirical_bayes(&residuals)
        })
        .collect();
    let mean = estimates.iter().sum::<f64>() / f64::from(samples);
    let spread = estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / f64::from(samples - 1);
    let error = (spread / f64::from(samples)).sqrt();
    assert!(error < 0.002 && (mean - truth).abs() < 4.0 * error, "{mean} +- {error}");
}

/// A tenth of the pixels states four times its true, large variance: the moments fall to 0, Huber's estimate does not.
#[test]
fn overstated_variances_mislead_the_moments_only() {
    let mut random = Random(3);
    let truth: f64 = 0.0225;
    let residuals: Vec<_> = (0..20_000)
        .map(|i| {
            let (actual, stated): (f64, f64) = if i % 10 == 0 { (0.25, 1.0) } else { (0.01, 0.01) };
            Residual { delta: (truth + actual).sqrt() * random.normal(), variance: stated }
        })
        .collect();
    assert_eq!(empirical_bayes(&residuals), 0.0);
    let s = huber_variance(&residuals);
    assert!((s - truth).abs() < 0.2 * truth, "{s}");
}

#[test]
fn no_residuals_and_zeros_give_zero() {
    for estimate in ESTIMATORS {
        assert_eq!(estimate(&[]), 0.0);
        assert_eq!(estimate(&[Residual::default(); 3]), 0.0);
        let one = estimate(&[Residual { delta: 0.5, variance: 0.0 }]);
        assert!(one.is_finite() && one >= 0.0);
    }
}

#[test]
fn the_heteroscedastic_terms_are_recovered() {
    let mut random = Random(8);
    let truth = Heteroscedastic { constant: 0.01, gradient: 0.5, disparity: 2e-4 };
    let pixels: Vec<(Residual, f64, f64)> = (0..400_000)
        .map(|_| {
            let (depth, gradient2) = (1.0 + 4.0 * random.uniform(), 0.1 * random.uniform());
            let variance = 0.02 * random.uniform();
            let sigma = (truth.variance(depth, gradient2) + variance).sqrt();
            (Residual { delta: sigma * random.normal(), variance }, depth, gradient2)
        })
        .collect();
    let fit = Heteroscedastic::fit(pixels.iter().map(|(r, depth, gradient2)| (r, *depth, *gradient2)));
    assert_relative_eq!(fit.constant, truth.constant, max_relative = 0.1);
    assert_relative_eq!(fit.gradient, truth.gradient, max_relative = 0.1);
    assert_relative_eq!(fit.disparity, truth.disparity, max_relative = 0.05);
}

#[test]
fn the_constant_term_alone_is_eq_15() {
    let residuals = [0.3, -0.2, 0.5, 0.1].map(|delta| Residual { delta, variance: 0.01 });
    let fit = Heteroscedastic::fit(residuals.iter().map(|r| (r, 2.0, 0.0)));
    // At one depth the third term is the first in disguise; together they are the constant.
    assert_relative_eq!(fit.variance(2.0, 0.0), empirical_bayes(&residuals), max_relative = 1e-9);
    assert_eq!(fit.gradient, 0.0);
}

#[test]
fn gradients_are_central_inside_and_one_sided_beside_a_gap() {
    let plane = Array2::from_shape_fn((4, 5), |(r, c)| 10.0 + 3.0 * r as f64 + 4.0 * c as f64);
    for g in squared_gradient(plane.view()) {
        assert_relative_eq!(g, 25.0);
    }
    let gap = array![[1.0, 2.0, 0.0, 7.0]];
    assert_eq!(squared_gradient(gap.view()), array![[1.0, 1.0, 0.0, 0.0]]);
}
