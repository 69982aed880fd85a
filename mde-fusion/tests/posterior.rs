//! Theorems of Eq. 16-17 and of the change of space.
#![allow(clippy::unwrap_used)]

use approx::assert_relative_eq;
use mde_fusion::proptest::gaussian;
use mde_fusion::{Gaussian, nerf_weight, posterior, precision_weighted, to_depth, to_disparity};
use proptest::prelude::*;

fn assert_close(a: Gaussian, b: Gaussian, max_relative: f64) {
    assert_relative_eq!(a.mean, b.mean, max_relative = max_relative);
    assert_relative_eq!(a.variance, b.variance, max_relative = max_relative);
}

proptest! {
    #[test]
    fn the_printed_form_is_the_same_number(prior in gaussian(), views in gaussian()) {
        let precision = 1.0 / prior.variance + 1.0 / views.variance;
        let mean = (prior.mean / prior.variance + views.mean / views.variance) / precision;
        let fused = posterior(prior, views);
        assert_relative_eq!(fused.mean, mean, max_relative = 1e-12);
        assert_relative_eq!(fused.variance, 1.0 / precision, max_relative = 1e-12);
        assert_close(fused, precision_weighted(&[prior, views]).unwrap(), 1e-12);
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
    fn scaling_the_unit_scales_the_mean_and_squares_in_the_variance(
        prior in gaussian(), views in gaussian(), k in 0.01..100.0_f64,
    ) {
        let scaled = |g: Gaussian| Gaussian::new(k * g.mean, k * k * g.variance);
        let (one, other) = (posterior(prior, views), posterior(scaled(prior), scaled(views)));
        assert_close(other, scaled(one), 1e-12);
    }

    #[test]
    fn an_exact_side_wins_and_the_prior_wins_a_draw(prior in gaussian(), views in gaussian()) {
        let exact = |g: Gaussian| Gaussian::new(g.mean, 0.0);
        prop_assert_eq!(posterior(exact(prior), views), exact(prior));
        prop_assert_eq!(posterior(prior, exact(views)), exact(views));
        prop_assert_eq!(posterior(exact(prior), exact(views)), exact(prior));
    }

    #[test]
    fn disparity_and_back_is_the_identity(mean in 1e-3..1e3_f64, relative in 0.0..4.0_f64) {
        let depth = Gaussian::new(mean, (relative * mean).powi(2));
        let back = to_depth(to_disparity(depth).unwrap()).unwrap();
        assert_close(back, depth, 1e-6);
    }

    #[test]
    fn an_exact_depth_has_an_exact_disparity(mean in 1e-3..1e3_f64) {
        let disparity = to_disparity(Gaussian::new(mean, 0.0)).unwrap();
        assert_close(disparity, Gaussian::new(1.0 / mean, 0.0), 1e-15);
    }
}

/// Against the moments of 1/X for a lognormal X, which are known exactly: E = e^{-m + s^2/2},
/// Var = (e^{s^2} - 1) E^2. Both agree to the next order in s^2.
#[test]
fn disparity_moments_match_a_lognormal() {
    for s2 in [1e-4_f64, 1e-3, 1e-2] {
        let depth_mean = (0.5 * s2).exp();
        let depth = Gaussian::new(depth_mean, s2.exp_m1() * depth_mean * depth_mean);
        let mean = (0.5 * s2).exp();
        let disparity = to_disparity(depth).unwrap();
        assert!((disparity.mean / mean - 1.0).abs() < s2 * s2, "{s2}: {disparity:?}");
        assert!((disparity.variance / (s2.exp_m1() * mean * mean) - 1.0).abs() < 4.0 * s2);
    }
}

#[test]
fn what_has_no_disparity_is_refused() {
    for mean in [0.0, -1.0, f64::NAN] {
        assert_eq!(to_disparity(Gaussian::new(mean, 0.1)), None);
        assert_eq!(to_depth(Gaussian::new(mean, 0.1)), None);
    }
    assert_eq!(to_disparity(Gaussian::new(1e-200, 0.1)), None);
}
