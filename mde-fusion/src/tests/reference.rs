//! Against NumPy: the values of `reference/fusion.csv`, made by `reference/fusion.py`.
use super::common::unclamped;
use crate::{
    Affine, Aggregation, BayesFuser, Fuser, GaussianDepth, Prior, Sample, affine_wls, aggregate,
    empirical_bayes, residuals,
};
use approx::assert_relative_eq;
use ndarray::Array2;
use std::collections::HashMap;

struct Reference(HashMap<&'static str, Vec<f64>>);

impl Reference {
    fn load() -> Self {
        let line = |line: &'static str| {
            let (name, values) = line.split_once(',').unwrap();
            (name, values.split(',').map(|v| v.parse().unwrap()).collect())
        };
        Self(include_str!("reference/fusion.csv").lines().map(line).collect())
    }

    fn get(&self, name: &str) -> &[f64] {
        &self.0[name]
    }

    fn shape(&self) -> (usize, usize) {
        (self.get("shape")[0] as usize, self.get("shape")[1] as usize)
    }

    fn map(&self, values: &[f64]) -> Array2<f32> {
        Array2::from_shape_vec(self.shape(), values.iter().map(|&v| v as f32).collect()).unwrap()
    }

    fn views(&self) -> Vec<GaussianDepth> {
        let pixels = self.shape().0 * self.shape().1;
        let planes = self.get("view").chunks(pixels).zip(self.get("variance").chunks(pixels));
        planes.map(|(m, v)| GaussianDepth::new(self.map(m), self.map(v)).unwrap()).collect()
    }

    /// The samples in full precision, from the reference's own aggregate.
    fn samples(&self) -> Vec<Sample> {
        let views = self.get("aggregated-mean").iter().zip(self.get("aggregated-variance"));
        let all = views.zip(self.get("prior"));
        all.filter(|((_, v), p)| v.is_finite() && **p > 0.0)
            .map(|((&u, &variance), &v)| Sample { u, variance, v })
            .collect()
    }
}

fn assert_map(map: &GaussianDepth, mean: &[f64], variance: &[f64]) {
    for (i, (&m, &v)) in map.mean().iter().zip(map.variance()).enumerate() {
        assert_eq!(v.is_infinite(), variance[i].is_infinite(), "pixel {i}");
        if v.is_finite() {
            assert_relative_eq!(f64::from(m), mean[i], max_relative = 1e-6);
            assert_relative_eq!(f64::from(v), variance[i], max_relative = 2e-5);
        }
    }
}

#[test]
fn aggregation() {
    let r = Reference::load();
    let rules = [(Aggregation::Precision, "aggregated-variance"), (Aggregation::Mixture, "mixture-variance")];
    for (rule, variance) in rules {
        let map = aggregate(&r.views(), rule).unwrap();
        assert_map(&map, r.get("aggregated-mean"), r.get(variance));
    }
}

#[test]
fn least_squares() {
    let r = Reference::load();
    let samples = r.samples();
    let [count, effective, correlation] = *r.get("diagnostics") else { panic!("three values") };
    assert_eq!(samples.len() as f64, count);
    let wls = affine_wls(&samples).unwrap();
    assert_relative_eq!(wls.affine.a, r.get("wls")[0], max_relative = 1e-10);
    assert_relative_eq!(wls.affine.b, r.get("wls")[1], max_relative = 1e-9);
    assert_relative_eq!(wls.effective_support, effective, max_relative = 1e-10);
    assert_relative_eq!(wls.correlation, correlation, max_relative = 1e-10);
}

#[test]
fn prior_variance() {
    let r = Reference::load();
    let [a, b] = *r.get("wls") else { panic!("two values") };
    let residuals = residuals(&r.samples(), Affine { a, b });
    for (residual, &delta) in residuals.iter().zip(r.get("delta")) {
        assert_relative_eq!(residual.delta, delta, max_relative = 1e-9, epsilon = 1e-12);
    }
    assert_relative_eq!(empirical_bayes(&residuals), r.get("moments")[0], max_relative = 1e-9);
}

#[test]
fn the_whole_fusion() {
    let r = Reference::load();
    // The reference has no clamp.
    let prior = Prior::new(r.map(r.get("prior"))).unwrap();
    let fused = BayesFuser::new(unclamped()).unwrap().fuse(&prior, &r.views()).unwrap();
    assert_map(&fused.depth, r.get("refined"), r.get("refined-variance"));
    assert_relative_eq!(fused.report.a, r.get("wls")[0], max_relative = 1e-6);
    assert_relative_eq!(fused.report.b, r.get("wls")[1], max_relative = 1e-5);
    assert_relative_eq!(fused.report.sigma_o, r.get("sigma-o")[0], max_relative = 1e-6);
    assert_relative_eq!(fused.report.nerf_weight, r.get("nerf-weight")[0], max_relative = 1e-6);
    for (value, expected) in fused.report.variance_quantiles.iter().zip(r.get("quantiles")) {
        assert_relative_eq!(value, expected, max_relative = 1e-6);
    }
}
