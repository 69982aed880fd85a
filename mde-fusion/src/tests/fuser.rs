//! Theorems of the whole fusion, and each choice of the configuration.
use super::common::{config, difference, map, normal, scene, unclamped, wild_scene};
use crate::{
    Aggregation, BayesFuser, Calibration, Degenerate, Error, Fused, Fuser, Fusion, FusionConfig,
    GaussianDepth, Prior, PriorVariance, VarianceRule, Warning,
};
use approx::assert_relative_eq;
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::median;
use ndarray::{Array2, array};
use proptest::prelude::*;

fn fuse(config: FusionConfig, prior: &Prior, views: &[GaussianDepth]) -> Fused {
    BayesFuser::new(config).unwrap().fuse(prior, views).unwrap()
}

/// A seeded slope with a step, a noisy prior of it, and views of it at another scale and shift. Seven of sixteen columns in
/// the first row have no view, the last pixel no prior.
fn room() -> (Prior, Vec<GaussianDepth>) {
    let mut rng = CounterRng::new(1, "fusion-test", 0, 0);
    let truth = |r: usize, c: usize| 2.0 + 0.05 * r as f64 + 0.04 * c as f64 + if c > 8 { 1.0 } else { 0.0 };
    let mut prior = Array2::from_shape_fn((12, 16), |(r, c)| (truth(r, c) + 0.2 * normal(&mut rng)) as f32);
    prior[(11, 15)] = 0.0;
    let view = |rng: &mut CounterRng| {
        let (mut mean, mut variance) = GaussianDepth::missing(12, 16).into_parts();
        for ((r, c), m) in mean.indexed_iter_mut() {
            if r > 0 || c > 6 {
                let sigma = rng.random_range(0.02..0.1);
                *m = ((truth(r, c) + sigma * normal(rng) - 0.2) / 1.2) as f32;
                variance[(r, c)] = (sigma / 1.2).powi(2) as f32;
            }
        }
        GaussianDepth::new(mean, variance).unwrap()
    };
    (Prior::new(prior).unwrap(), (0..3).map(|_| view(&mut rng)).collect())
}

proptest! {
    #[test]
    fn no_input_makes_nan_or_a_panic((prior, views) in wild_scene(), config in config()) {
        let fused = fuse(config, &prior, &views);
        for map in [&fused.depth, &fused.aggregated, &fused.aligned] {
            prop_assert_eq!(map.dim(), prior.dim());
            prop_assert!(map.mean().iter().all(|m| m.is_finite()));
            prop_assert!(map.variance().iter().all(|v| *v >= 0.0));
        }
        for (m, v) in fused.depth.mean().iter().zip(fused.depth.variance()) {
            prop_assert!(*m > 0.0 || v.is_infinite());
        }
        let r = &fused.report;
        let numbers = [r.a, r.b, r.sigma_o, r.effective_support, r.correlation, r.nerf_weight];
        prop_assert!(numbers.iter().chain(&r.variance_quantiles).all(|x| x.is_finite()), "{:?}", r);
        prop_assert!((0.0..=1.0).contains(&r.nerf_weight));
    }

    #[test]
    fn the_paper_result_lies_between_prior_and_views((prior, views) in scene(6, 4)) {
        let fused = fuse(FusionConfig::paper(), &prior, &views);
        let sigma2 = fused.report.sigma_o.powi(2);
        for ((r, c), &d) in prior.mean().indexed_iter() {
            let d = f64::from(d);
            match (fused.depth.get(r, c), fused.aligned.get(r, c)) {
                (None, _) => prop_assert_eq!(d, 0.0),
                (Some((m, v)), Some((a, c))) if fused.report.degenerate.is_none() && f64::from(a) > 0.0 => {
                    let (m, a) = (f64::from(m), f64::from(a));
                    let slack = 1e-6 * d.max(a);
                    prop_assert!(m >= d.min(a) - slack && m <= d.max(a) + slack);
                    prop_assert!(f64::from(v) <= sigma2 * (1.0 + 1e-6) && v <= c);
                }
                (Some((m, _)), _) if fused.report.degenerate.is_some() => prop_assert_eq!(f64::from(m), d),
                // No support: D_o and sigma_o^2.
                (Some((m, v)), None) => {
                    prop_assert_eq!(f64::from(m), d);
                    assert_relative_eq!(f64::from(v), sigma2, max_relative = 1e-6);
                }
                _ => {}
            }
        }
    }

    #[test]
    fn a_prior_without_views_is_the_result((prior, _) in scene(6, 0), config in config()) {
        let fused = fuse(config, &prior, &[]);
        prop_assert_eq!(fused.depth.mean(), prior.mean());
        prop_assert!(fused.report.support == 0 && fused.report.nerf_weight == 0.0);
        let unsupported = matches!(fused.report.degenerate, Some(Degenerate::Support { found: 0 }));
        prop_assert!(unsupported);
    }

    #[test]
    fn the_unit_does_not_matter(k in 0.01..100.0_f64) {
        let (prior, views) = room();
        let scaled: Vec<_> = views.iter().map(|view| map(view, |m, v| (k * m, k * k * v))).collect();
        let scaled_prior = Prior::new(prior.mean().mapv(|d| (k * f64::from(d)) as f32)).unwrap();
        for config in [FusionConfig::paper(), FusionConfig { aggregation: Aggregation::Mixture, ..FusionConfig::paper() }] {
            let one = fuse(config.clone(), &prior, &views);
            let other = fuse(config, &scaled_prior, &scaled);
            let expected = map(&one.depth, |m, v| (k * m, k * k * v));
            prop_assert!(difference(&expected, &other.depth) < 1e-4);
            assert_relative_eq!(other.report.sigma_o, k * one.report.sigma_o, max_relative = 1e-4);
            assert_relative_eq!(other.report.a, one.report.a, max_relative = 1e-5);
        }
    }

    /// The calibration inverts any affine map of the views, so the result does not depend on it.
    #[test]
    fn an_affine_map_of_the_views_does_not_matter(k in 0.2..5.0_f64, c in -1.0..3.0_f64) {
        let (prior, views) = room();
        let moved: Vec<_> = views.iter().map(|view| map(view, |m, v| (k * m + c, k * k * v))).collect();
        let (one, other) = (fuse(unclamped(), &prior, &views), fuse(unclamped(), &prior, &moved));
        prop_assert!(difference(&one.depth, &other.depth) < 1e-3);
        assert_relative_eq!(other.report.a * k, one.report.a, max_relative = 1e-4);
        assert_relative_eq!(other.report.sigma_o, one.report.sigma_o, max_relative = 1e-4);
    }

    #[test]
    fn views_that_are_the_prior_return_it(k in 0.5..2.0_f64, c in 0.0..2.0_f64) {
        let (prior, _) = room();
        let known = prior.mean().mapv(|d| if d > 0.0 { 0.01 } else { f32::INFINITY });
        let same = GaussianDepth::new(prior.mean().to_owned(), known).unwrap();
        let fused = fuse(FusionConfig::paper(), &prior, &[map(&same, |m, v| (k * m + c, v))]);
        for (fused, prior) in fused.depth.mean().iter().zip(prior.mean()) {
            assert_relative_eq!(*fused, *prior, max_relative = 1e-5);
        }
        // The residuals are below the stated variances, so Eq. 15 clamps.
        prop_assert!(fused.report.sigma_o_clamped && fused.report.warnings.contains(&Warning::PriorTakenAsExact));
        // Without the prior in the result, neither matters.
        let alone = fuse(FusionConfig { fusion: Fusion::NerfOnly, ..FusionConfig::paper() }, &prior, &[map(&same, |m, v| (k * m + c, v))]);
        prop_assert!(!alone.report.sigma_o_clamped && !alone.report.warnings.contains(&Warning::PriorTakenAsExact));
    }
}

#[test]
fn views_beat_a_noisy_prior() {
    let (prior, views) = room();
    let fused = fuse(FusionConfig::paper(), &prior, &views);
    let r = &fused.report;
    assert!(r.degenerate.is_none() && r.warnings.is_empty(), "{r:?}");
    assert_eq!(r.support, 12 * 16 - 7 - 1);
    assert!((r.a - 1.2).abs() < 0.1 && (r.sigma_o - 0.2).abs() < 0.03, "{r:?}");
    assert!(r.nerf_weight > 0.9 && r.correlation > 0.9 && r.effective_support > 50.0);
    let [q5, q25, q50, q75, q95] = r.variance_quantiles;
    assert!(0.0 < q5 && q5 < q25 && q25 < q50 && q50 < q75 && q75 < q95);
    // Missing in the prior, but not in the views.
    assert!(fused.depth.get(11, 15).is_none() && fused.aligned.get(11, 15).is_some());
}

#[test]
fn each_ablation_changes_the_result() {
    let (prior, views) = room();
    let paper = FusionConfig::paper;
    let full = fuse(paper(), &prior, &views);
    let rows = [
        FusionConfig { variance: VarianceRule::ConstantMedian, ..paper() },
        FusionConfig { aggregation: Aggregation::MinDepth, ..paper() },
        FusionConfig { calibration: Calibration::None, ..paper() },
        FusionConfig { prior_variance: PriorVariance::FixedMedian, ..paper() },
        FusionConfig { prior_variance: PriorVariance::FixedRelative, ..paper() },
        FusionConfig { fusion: Fusion::NerfOnly, ..paper() },
        FusionConfig { aggregation: Aggregation::Mixture, ..paper() },
    ];
    for row in rows {
        let ablated = fuse(row.clone(), &prior, &views);
        assert!(ablated.report.degenerate.is_none(), "{row:?}");
        assert!(difference(&full.depth, &ablated.depth) > 1e-6, "{row:?}");
        if row.calibration == Calibration::None {
            assert_eq!((ablated.report.a, ablated.report.b), (1.0, 0.0));
        }
        if row.fusion == Fusion::NerfOnly {
            assert_eq!(ablated.report.nerf_weight, 1.0);
            assert_eq!(ablated.depth.get(5, 5), ablated.aligned.get(5, 5));
            // No view: the prior.
            assert_eq!(ablated.depth.mean()[(0, 0)], prior.mean()[(0, 0)]);
        }
        if row.prior_variance == PriorVariance::FixedMedian {
            // The views' weight by the variances: w = posterior / (a^2 v).
            let weights = ablated.depth.variance().to_owned() / ablated.aligned.variance();
            let weight = median(weights.into_iter().filter(|w| w.is_finite() && *w > 0.0)).unwrap();
            assert_relative_eq!(weight, 0.5, epsilon = 0.05);
        }
    }
}

#[test]
fn a_prior_with_its_own_variance_keeps_it() {
    let (prior, views) = room();
    let first = fuse(FusionConfig::paper(), &prior, &views);
    let carried = Prior::with_variance(first.depth.clone()).unwrap();
    let second = fuse(FusionConfig::paper(), &carried, &views);
    assert!(!second.report.sigma_o_clamped);
    // Without a view the prior is returned unchanged.
    for c in 0..7 {
        assert_eq!(second.depth.get(0, c), first.depth.get(0, c));
    }
    for ((pixel, &before), &after) in first.depth.variance().indexed_iter().zip(second.depth.variance()) {
        assert!(after <= before, "{pixel:?}");
    }
    // The rms of the variance over the overlap.
    let inside = first.aligned.support();
    let variance = first.depth.variance();
    let over = variance.indexed_iter().filter(|(p, v)| inside[*p] && v.is_finite());
    let (sum, count) = over.fold((0.0, 0.0), |(s, n), (_, v)| (s + f64::from(*v), n + 1.0));
    assert_relative_eq!(second.report.sigma_o, (sum / count).sqrt(), max_relative = 1e-6);
}

#[test]
fn degenerate_calibrations_give_the_prior_and_a_reason() {
    let (prior, views) = room();
    let mirrored: Vec<_> = views.iter().map(|view| map(view, |m, v| (10.0 - m, v))).collect();
    let flat: Vec<_> = views.iter().map(|view| map(view, |_, v| (2.0, v))).collect();
    let mut variance = Array2::from_elem((12, 16), f32::INFINITY);
    variance[(4, 4)] = 0.01;
    let one = [GaussianDepth::new(Array2::from_elem((12, 16), 2.0), variance).unwrap()];
    let cases = [
        (&mirrored[..], "the scale -"),
        (&flat, "the views' depth is constant"),
        (&one, "only 1 pixels have both a prior depth and a view"),
    ];
    for (views, expected) in cases {
        let fused = fuse(FusionConfig::paper(), &prior, views);
        let reason = fused.report.degenerate.unwrap();
        assert!(reason.to_string().starts_with(expected), "{reason}");
        assert!(fused.report.warnings.contains(&Warning::Degenerate { reason }));
        assert_eq!(fused.depth.mean(), prior.mean());
        assert_eq!((fused.report.a, fused.report.b, fused.report.nerf_weight), (1.0, 0.0, 0.0));
        // No estimate exists: a tenth of the median depth.
        let sigma = fused.depth.sigma()[(0, 0)];
        assert!(sigma > 0.2 && sigma < 0.4 && (f64::from(sigma) - fused.report.sigma_o).abs() < 1e-6);
    }
}

#[test]
fn a_depth_that_is_not_positive_reverts_and_is_counted() {
    let prior = Prior::new(array![[1.0, 2.0, 3.0, 4.0, 5.0, 0.5]]).unwrap();
    let mean = array![[1.0, 2.0, 3.0, 4.0, 5.0, -9.0]];
    let view = GaussianDepth::new(mean, array![[0.01, 0.01, 0.01, 0.01, 0.01, 1.0]]).unwrap();
    let fused = fuse(FusionConfig { fusion: Fusion::NerfOnly, ..FusionConfig::paper() }, &prior, &[view]);
    assert_eq!(fused.report.reverted, 1);
    assert_eq!(fused.depth.mean()[(0, 5)], 0.5);
    assert!(fused.report.warnings.contains(&Warning::NotPositive { pixels: 1 }));
}

#[test]
fn a_common_error_adds_its_share_of_the_depth_and_leaves_the_mean() {
    let prior = Prior::new(array![[1.0, 2.0, 3.0, 4.5]]).unwrap();
    let view =
        GaussianDepth::new(array![[1.1, 1.8, 3.3, 0.0]], array![[0.1, 0.2, 0.1, f32::INFINITY]]).unwrap();
    let paper = fuse(FusionConfig::paper(), &prior, std::slice::from_ref(&view));
    let common = fuse(FusionConfig { common_error: 0.1, ..FusionConfig::paper() }, &prior, &[view]);
    assert_eq!(paper.depth.mean(), common.depth.mean());
    for ((&mean, &before), &after) in
        paper.depth.mean().iter().zip(paper.depth.variance()).zip(common.depth.variance())
    {
        let expected = before + (0.1 * mean).powi(2);
        assert!((after - expected).abs() <= 1e-6 * expected, "{after} {expected}");
    }
}

#[test]
fn bad_input_is_named() {
    let prior = Prior::new(Array2::ones((2, 3))).unwrap();
    let views = [GaussianDepth::missing(2, 3), GaussianDepth::missing(2, 4)];
    let error = BayesFuser::default().fuse(&prior, &views).unwrap_err();
    assert!(matches!(error, Error::Shape { view: 1, expected: [2, 3], found: [2, 4] }), "{error}");
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let error = Prior::new(array![[1.0, bad]]).unwrap_err();
        assert!(matches!(error, Error::Depth { row: 0, column: 1, .. }), "{error}");
    }
    let zero = GaussianDepth::new(array![[0.0]], array![[1.0]]).unwrap();
    assert!(matches!(Prior::with_variance(zero), Err(Error::Depth { row: 0, column: 0, .. })));
}

#[test]
fn bad_configurations_are_named() {
    let paper = FusionConfig::paper();
    paper.validate().unwrap();
    let bad = [
        (FusionConfig { variance_floor: -1.0, ..paper.clone() }, "fusion.variance-floor is -1; "),
        (FusionConfig { common_error: 1.0, ..paper.clone() }, "fusion.common-error is 1; "),
        (FusionConfig { common_error: f64::NAN, ..paper.clone() }, "fusion.common-error is NaN; "),
        (FusionConfig { kappa: 0.0, ..paper }, "fusion.kappa is 0; "),
    ];
    for (config, message) in bad {
        let error = BayesFuser::new(config).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}
