//! The robust line and its variance.

use super::common::normal;
use crate::{LinePoint, RobustLine};
use mde_uncertainty::random::CounterRng;
use proptest::prelude::*;

/// Points of a line with 5 % error in `u`, each from its number and its `u`.
fn points(count: usize, v: impl Fn(usize, f64) -> f64) -> Vec<LinePoint> {
    let point = |i: usize| {
        let u = 1.0 + 3.0 * (0.5 + 0.5 * (1.7 * i as f64).sin());
        LinePoint { u, u_variance: (0.05 * u).powi(2), v: v(i, u), v_variance: 0.0 }
    };
    (0..count).map(point).collect()
}

proptest! {
    /// An exact line is found; a tenth of wrong points does not matter.
    #[test]
    fn an_exact_line_is_found(a in 0.2..5.0_f64, b in 0.0..0.4_f64, needs_shift: bool, wrong: bool) {
        let points = points(110, |i, u| if wrong && i % 10 == 0 { 3.0 } else { 1.0 } * (a * u + b));
        let line = RobustLine::fit(&points, needs_shift).unwrap();
        let off = |u: f64| ((line.affine.a * u + line.affine.b) / (a * u + b) - 1.0).abs();
        let worst = points.iter().map(|p| off(p.u)).fold(0.0, f64::max);
        prop_assert!(worst < if wrong { 0.01 } else { 1e-3 }, "{worst} {line:?}");
    }
}

#[test]
fn the_variance_covers_the_line() {
    // Noise of 10 % on 12 points: the error of the mean is about 3 %.
    let (mut within, mut sigmas) = (0, Vec::new());
    for seed in 0..200 {
        let noisy = |i: usize, u: f64| {
            2.0 * u * (1.0 + 0.1 * normal(&mut CounterRng::new(5, "line", seed, i as u64)))
        };
        let line = RobustLine::fit(&points(12, noisy), false).unwrap();
        let sigma = line.variance(2.5).sqrt();
        within += usize::from((line.affine.a * 2.5 + line.affine.b - 5.0).abs() < 1.645 * sigma);
        sigmas.push(sigma / 5.0);
    }
    sigmas.sort_by(f64::total_cmp);
    assert!((150..=196).contains(&within), "{within} of 200");
    assert!((0.015..0.06).contains(&sigmas[100]), "{}", sigmas[100]);
}

#[test]
fn a_falling_line_is_none() {
    assert_eq!(RobustLine::fit(&points(20, |_, u| 1.0 / u), true), None);
}
