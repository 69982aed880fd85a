//! Helpers and strategies shared by the tests.
use crate::{
    Aggregation, Calibration, Fusion, FusionConfig, Gaussian, GaussianDepth, Prior, PriorVariance, Sample,
    VarianceRule,
};
use mde_uncertainty::normal::quantile;
use mde_uncertainty::proptest::gaussian_depth_of;
use mde_uncertainty::random::CounterRng;
use ndarray::Array2;
use proptest::collection::vec;
use proptest::prelude::*;

/// Applies `f` to every pixel that is not missing.
pub(crate) fn map(view: &GaussianDepth, f: impl Fn(f64, f64) -> (f64, f64)) -> GaussianDepth {
    view.clone().map(|m, v| {
        let (m, v) = f(m.into(), v.into());
        (m as f32, v as f32)
    })
}

/// Largest relative difference of two maps; infinite where one alone misses a pixel.
pub(crate) fn difference(a: &GaussianDepth, b: &GaussianDepth) -> f64 {
    assert_eq!(a.dim(), b.dim());
    let relative = |(&x, &y): (&f32, &f32)| {
        let (x, y) = (f64::from(x), f64::from(y));
        if x == y { 0.0 } else { (x - y).abs() / x.abs().max(y.abs()) }
    };
    let pairs = a.mean().into_iter().zip(b.mean()).chain(a.variance().into_iter().zip(b.variance()));
    pairs.map(relative).fold(0.0, f64::max)
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut CounterRng) -> f64 {
    quantile(rng.random())
}

/// A prior and up to `max_views` views of it, at most `max_side` pixels per side: depths in 0.5 to 10, variances in
/// 1e-6 to 1, some pixels missing in each.
pub(crate) fn scene(max_side: usize, max_views: usize) -> impl Strategy<Value = (Prior, Vec<GaussianDepth>)> {
    (1..=max_side, 1..=max_side).prop_flat_map(move |(height, width)| {
        let prior = gaussian_depth_of(height, width).prop_map(|map| Prior::new(map.into_parts().0).unwrap());
        (prior, vec(gaussian_depth_of(height, width), 0..=max_views))
    })
}

/// As [`scene`], with extreme inputs: constant and empty maps, variance 0, subnormal and huge values, negative views, priors with
/// a variance.
pub(crate) fn wild_scene() -> impl Strategy<Value = (Prior, Vec<GaussianDepth>)> {
    let value = prop_oneof![
        4 => 0.5..10.0_f32,
        1 => prop::sample::select(vec![1e-45, f32::MIN_POSITIVE, 1e-20, 1.0, 1.0, 1e20, f32::MAX]),
    ];
    let variance =
        prop_oneof![4 => 1e-6..1.0_f32, 1 => Just(0.0), 1 => Just(f32::INFINITY), 1 => value.clone()];
    (1..=6_usize, 1..=6_usize, 0..3_u8).prop_flat_map(move |(height, width, kind)| {
        // Kind 0: one value everywhere. Kind 1: all missing. Kind 2: per pixel.
        let values = if kind == 0 { 1 } else { height * width };
        let variance = if kind == 1 { Just(f32::INFINITY).boxed() } else { variance.clone().boxed() };
        let depth = (vec(value.clone(), values), vec(variance, values)).prop_map(move |planes| {
            let map =
                |v: Vec<f32>| Array2::from_shape_fn((height, width), |(r, c)| v[(r * width + c) % values]);
            GaussianDepth::new(map(planes.0), map(planes.1)).unwrap()
        });
        let sign = prop::sample::select(vec![1.0_f32, 1.0, 1.0, -1.0]);
        let view = (depth.clone(), sign).prop_map(|(depth, sign)| depth.map(|m, v| (sign * m, v)));
        let prior = (depth, any::<bool>()).prop_map(|(depth, with_variance)| match with_variance {
            true => Prior::with_variance(depth).unwrap(),
            false => Prior::new(depth.into_parts().0).unwrap(),
        });
        (prior, vec(view, 0..=4))
    })
}

/// `size` samples of the affine fit: depths in 0.5 to 10, variances in 1e-6 to 1, the first two far apart.
pub(crate) fn samples(size: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Sample>> {
    let sample = (gaussian(), 0.5..10.0_f64).prop_map(|(g, v)| Sample { u: g.mean, variance: g.variance, v });
    vec(sample, size).prop_map(|mut samples| {
        for (sample, u) in samples.iter_mut().zip([0.5, 10.0]) {
            (sample.u, sample.variance) = (u, 0.1);
        }
        samples
    })
}

/// A Gaussian with a mean in 0.5 to 10 and a variance in 1e-6 to 1.
pub(crate) fn gaussian() -> impl Strategy<Value = Gaussian> {
    (0.5..10.0_f64, -6.0..0.0_f64)
        .prop_map(|(mean, log_variance)| Gaussian::new(mean, 10_f64.powf(log_variance)))
}

/// A configuration without clamps, so that the equations stand alone.
pub(crate) fn unclamped() -> FusionConfig {
    FusionConfig { variance_floor: 0.0, ..FusionConfig::paper() }
}

/// Any combination of the choices in a [`FusionConfig`].
pub(crate) fn config() -> impl Strategy<Value = FusionConfig> {
    use prop::sample::select;
    let choices = (
        select(vec![VarianceRule::Computed, VarianceRule::ConstantMedian]),
        select(vec![Aggregation::Precision, Aggregation::Mixture, Aggregation::MinDepth]),
        select(vec![Calibration::Wls, Calibration::None]),
        select(vec![PriorVariance::Moments, PriorVariance::FixedMedian, PriorVariance::FixedRelative]),
        select(vec![Fusion::Bayes, Fusion::NerfOnly]),
        select(vec![0.0, 1e-3]),
    );
    choices.prop_map(|(variance, aggregation, calibration, prior_variance, fusion, floor)| FusionConfig {
        variance,
        variance_floor: floor,
        aggregation,
        calibration,
        prior_variance,
        kappa: 0.1,
        fusion,
        common_error: floor,
    })
}
