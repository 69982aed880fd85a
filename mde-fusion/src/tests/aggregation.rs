//! Theorems of Eq. 7-8 and of its alternative.
use super::common::{difference, gaussian};
use crate::aggregate::mixture_variance;
use crate::{Aggregation, Error, Gaussian, GaussianDepth, aggregate, precision_weighted};
use approx::assert_relative_eq;
use mde_uncertainty::proptest::gaussian_depth_of;
use ndarray::array;
use proptest::collection::vec;
use proptest::prelude::*;

const RULES: [Aggregation; 3] = [Aggregation::Precision, Aggregation::Mixture, Aggregation::MinDepth];

proptest! {
    #[test]
    fn aggregating_in_two_steps_is_aggregating_at_once(estimates in vec(gaussian(), 2..8), cut in 1..7_usize) {
        let (one, two) = estimates.split_at(cut.min(estimates.len() - 1));
        let halves = [precision_weighted(one).unwrap(), precision_weighted(two).unwrap()];
        let (nested, all) = (precision_weighted(&halves).unwrap(), precision_weighted(&estimates).unwrap());
        assert_relative_eq!(nested.mean, all.mean, max_relative = 1e-12);
        assert_relative_eq!(nested.variance, all.variance, max_relative = 1e-12);
    }

    #[test]
    fn the_mean_and_both_variances_have_their_bounds(estimates in vec(gaussian(), 1..8)) {
        let all = precision_weighted(&estimates).unwrap();
        let least = estimates.iter().map(|g| g.mean).fold(f64::INFINITY, f64::min);
        let most = estimates.iter().map(|g| g.mean).fold(0.0, f64::max);
        prop_assert!(all.mean >= least * (1.0 - 1e-14) && all.mean <= most * (1.0 + 1e-14));
        prop_assert!(estimates.iter().all(|g| all.variance <= g.variance * (1.0 + 1e-14)));
        // That of the mixture is at least k times that of the product.
        let mixture = mixture_variance(&estimates, all.mean);
        prop_assert!(mixture >= all.variance * estimates.len() as f64 * (1.0 - 1e-12));
    }

    #[test]
    fn copies_of_one_view_keep_its_mixture_variance(g in gaussian(), count in 1..9_usize) {
        let copies = vec![g; count];
        let all = precision_weighted(&copies).unwrap();
        assert_relative_eq!(all.mean, g.mean, max_relative = 1e-14);
        assert_relative_eq!(all.variance * count as f64, g.variance, max_relative = 1e-12);
        assert_relative_eq!(mixture_variance(&copies, all.mean), g.variance, max_relative = 1e-12);
    }

    #[test]
    fn neither_the_order_of_views_nor_a_missing_one_matters(
        (views, order) in vec(gaussian_depth_of(4, 5), 1..6)
            .prop_flat_map(|views| (Just(views.clone()), Just(views).prop_shuffle())),
    ) {
        for rule in RULES {
            let (one, other) = (aggregate(&views, rule).unwrap(), aggregate(&order, rule).unwrap());
            prop_assert!(difference(&one, &other) <= f64::from(f32::EPSILON), "{rule:?}");
            let more = [&views[..], &[GaussianDepth::missing(4, 5)]].concat();
            prop_assert_eq!(aggregate(&more, rule).unwrap(), one);
        }
    }

    #[test]
    fn one_view_is_itself(view in gaussian_depth_of(4, 5)) {
        for rule in RULES {
            prop_assert_eq!(&aggregate(std::slice::from_ref(&view), rule).unwrap(), &view);
        }
    }
}

#[test]
fn min_depth_takes_the_nearest_view() {
    let view = |m: f32, v: f32| GaussianDepth::new(array![[m]], array![[v]]).unwrap();
    let views = [view(3.0, 0.5), view(1.0, 0.4), view(2.0, 0.1)];
    let nearest = aggregate(&views, Aggregation::MinDepth).unwrap();
    assert_eq!(nearest.get(0, 0), Some((1.0, 0.4)));
}

#[test]
fn exact_estimates_count_alone() {
    let estimates = [Gaussian::new(1.0, 0.0), Gaussian::new(9.0, 1.0), Gaussian::new(2.0, 0.0)];
    let all = precision_weighted(&estimates).unwrap();
    assert_eq!(all, Gaussian::new(1.5, 0.0));
    assert_eq!(mixture_variance(&estimates, all.mean), 0.25);
    assert_eq!(precision_weighted(&[]), None);
}

#[test]
fn a_view_of_another_shape_is_named() {
    let views = [GaussianDepth::missing(2, 3), GaussianDepth::missing(3, 2)];
    let error = aggregate(&views, Aggregation::Precision).unwrap_err();
    assert!(matches!(error, Error::Shape { view: 1, expected: [2, 3], found: [3, 2] }), "{error}");
    assert_eq!(aggregate(&[], Aggregation::Precision).unwrap().dim(), (0, 0));
}
