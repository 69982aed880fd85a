//! Theorems of Eq. 10-14.
use super::common::samples;
use crate::{Affine, Sample, affine_wls, residuals};
use approx::assert_relative_eq;
use proptest::prelude::*;

proptest! {
    #[test]
    fn the_printed_closed_form_is_the_same_number(samples in samples(2..40)) {
        let terms: [fn(&Sample) -> f64; 5] = [|_| 1.0, |s| s.u, |s| s.v, |s| s.u * s.u, |s| s.u * s.v];
        let [p, pu, pv, puu, puv] =
            terms.map(|term| samples.iter().map(|s| term(s) / s.variance).sum::<f64>());
        let determinant = p * puu - pu * pu;
        // Below this the printed form itself has lost its digits.
        prop_assume!(determinant > 1e-5 * p * puu);
        let a = (p * puv - pu * pv) / determinant;
        let b = (pv - a * pu) / p;
        let fit = affine_wls(&samples).unwrap().affine;
        assert_relative_eq!(fit.a, a, max_relative = 1e-7, epsilon = 1e-8);
        assert_relative_eq!(fit.b, b, max_relative = 1e-7, epsilon = 1e-7);
    }

    #[test]
    fn an_exact_affine_relation_is_recovered(mut samples in samples(2..40), a in 0.1..5.0_f64, b in -3.0..3.0_f64) {
        for s in &mut samples {
            s.v = a * s.u + b;
        }
        let fit = affine_wls(&samples).unwrap();
        assert_relative_eq!(fit.affine.a, a, max_relative = 1e-9);
        assert_relative_eq!(fit.affine.b, b, max_relative = 1e-8, epsilon = 1e-8);
        assert_relative_eq!(fit.correlation, 1.0, max_relative = 1e-9);
        for r in residuals(&samples, Affine { a, b }) {
            assert_relative_eq!(r.delta, 0.0, epsilon = 1e-12);
        }
    }

    #[test]
    fn equivariant_to_affine_maps_of_either_side(
        samples in samples(2..40), k in 0.1..5.0_f64, c in -3.0..3.0_f64,
    ) {
        let fit = affine_wls(&samples).unwrap().affine;
        let scale = 1.0 + fit.a.abs();
        // u -> k u + c with its variance: the map is composed with the inverse.
        let nerf: Vec<_> = samples
            .iter()
            .map(|s| Sample { u: k * s.u + c, variance: k * k * s.variance, ..*s })
            .collect();
        let left = affine_wls(&nerf).unwrap().affine;
        assert_relative_eq!(left.a * k, fit.a, epsilon = 1e-7 * scale);
        assert_relative_eq!(left.b + left.a * c, fit.b, epsilon = 1e-6 * scale);
        // v -> k v + c: the map is followed by it.
        let prior: Vec<_> = samples.iter().map(|s| Sample { v: k * s.v + c, ..*s }).collect();
        let right = affine_wls(&prior).unwrap().affine;
        assert_relative_eq!(right.a, k * fit.a, epsilon = 1e-7 * scale);
        assert_relative_eq!(right.b, k * fit.b + c, epsilon = 1e-6 * scale);
    }

    #[test]
    fn the_ratios_of_the_variances_make_the_fit_and_its_support(samples in samples(2..40), k in 1e-3..1e3_f64) {
        let fit = affine_wls(&samples).unwrap();
        let scaled: Vec<_> = samples.iter().map(|s| Sample { variance: k * s.variance, ..*s }).collect();
        let other = affine_wls(&scaled).unwrap();
        assert_relative_eq!(fit.affine.a, other.affine.a, max_relative = 1e-8, epsilon = 1e-9);
        assert_relative_eq!(fit.effective_support, other.effective_support, max_relative = 1e-9);
        prop_assert!(fit.effective_support >= 1.0 - 1e-9);
        prop_assert!(fit.effective_support <= samples.len() as f64 * (1.0 + 1e-9));
        prop_assert!((-1.0..=1.0).contains(&fit.correlation));
        let equal: Vec<_> = samples.iter().map(|s| Sample { variance: 0.3, ..*s }).collect();
        let all = affine_wls(&equal).unwrap().effective_support;
        assert_relative_eq!(all, samples.len() as f64, max_relative = 1e-12);
    }
}

#[test]
fn a_constant_depth_determines_no_slope() {
    let sample = |prior| Sample { u: 2.1, variance: 0.01, v: prior };
    let samples: Vec<_> = (0..50).map(|i| sample(2.1 + f64::from(i % 3 - 1) * 0.1)).collect();
    assert_eq!(affine_wls(&samples), None);
    assert_eq!(affine_wls(&samples[..1]), None);
    assert_eq!(affine_wls(&[]), None);
}

#[test]
fn exact_samples_count_alone() {
    let sample = |u, variance, v| Sample { u, variance, v };
    let samples = [sample(1.0, 0.0, 3.0), sample(2.0, 0.0, 5.0), sample(9.0, 1.0, -40.0)];
    let fit = affine_wls(&samples).unwrap();
    assert_relative_eq!(fit.affine.a, 2.0);
    assert_relative_eq!(fit.affine.b, 1.0);
    assert_relative_eq!(fit.effective_support, 2.0);
}
