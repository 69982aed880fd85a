//! Against SciPy, scikit-image, scikit-learn and NumPy: `reference/metrics.py` made `reference/metrics.json`.

use crate::map;
use approx::assert_relative_eq;
use mde_eval::align::{Alignment, AlignmentRule};
use mde_eval::mde_uncertainty::statistics::{average_ranks, spearman};
use mde_eval::metrics::edges::{edge_curve, edges};
use mde_eval::metrics::superpixel::{SuperpixelPairs, d3r};
use mde_eval::metrics::{calibration, dbe, depth};
use mde_eval::ndarray::Array2;
use mde_eval::score::{ScoreConfig, Subject, score};
use serde_json::Value;

struct Reference {
    prediction: Array2<f32>,
    truth: Array2<f32>,
    sigma: Array2<f32>,
    mask: Array2<bool>,
    /// Aligned by the median.
    aligned: Array2<f32>,
    expected: Value,
}

impl Reference {
    fn read() -> Self {
        let file: Value = serde_json::from_str(include_str!("../reference/metrics.json")).unwrap();
        let [prediction, truth, sigma] =
            ["prediction", "truth", "sigma"].map(|name| map(&file["inputs"][name]));
        let (mask, expected) = (truth.mapv(|g| g > 0.0), file["expected"].clone());
        let scale = expected["median"].as_f64().unwrap();
        let mut aligned = prediction.mapv(|p| (f64::from(p) * scale) as f32);
        aligned.zip_mut_with(&mask, |p, &keep| *p = if keep { *p } else { 0.0 });
        Self { prediction, truth, sigma, mask, aligned, expected }
    }

    fn list(&self, map: &Array2<f32>) -> Vec<f64> {
        map.iter().zip(&self.mask).filter(|m| *m.1).map(|m| f64::from(*m.0)).collect()
    }

    fn value(&self, name: &str) -> f64 {
        self.expected[name].as_f64().unwrap()
    }

    fn values(&self, name: &str) -> Vec<f64> {
        numbers(&self.expected[name])
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap()
}

fn near(found: f64, expected: f64) {
    assert_relative_eq!(found, expected, max_relative = 1e-9, epsilon = 1e-12);
}

#[test]
fn alignments() {
    let r = Reference::read();
    let (p, g) = (r.list(&r.prediction), r.list(&r.truth));
    for (rule, name) in [(AlignmentRule::Median, "median"), (AlignmentRule::MedianRatio, "median-ratio")] {
        let Alignment::Depth { scale, shift } = rule.fit(&p, &g).unwrap() else { panic!() };
        near(scale, r.value(name));
        assert_eq!(shift, 0.0);
    }
    let [in_depth, alignment] = [AlignmentRule::LeastSquaresDepth, AlignmentRule::LeastSquaresDisparity]
        .map(|rule| rule.fit(&p, &g).unwrap());
    for (fitted, name) in [(in_depth, "ls-depth"), (alignment, "ls-disparity")] {
        let (Alignment::Depth { scale, shift } | Alignment::Disparity { scale, shift, .. }) = fitted;
        let expected = r.values(name);
        near(scale, expected[0]);
        near(shift, expected[1]);
    }
    assert!(matches!(alignment, Alignment::Disparity { .. }));
    let aligned: Vec<f64> = p.iter().map(|&p| alignment.depth(p)).collect();
    near(depth::rmse(&aligned, &g).unwrap(), r.value("ls-disparity-rmse"));
}

#[test]
fn edge_scores() {
    let r = Reference::read();
    let (p, g, m) = (r.aligned.view(), r.truth.view(), r.mask.view());
    for case in r.expected["edges"].as_array().unwrap() {
        let threshold = case["threshold"].as_f64().unwrap();
        let tolerance = case["tolerance"].as_u64().unwrap() as u32;
        let true_edges = edges(g, m, threshold).unwrap();
        let curve = edge_curve(p, m, &true_edges, tolerance).unwrap().unwrap();
        let found = curve.at(threshold);
        let found = [found.precision, found.recall, found.f1()];
        found.into_iter().zip(numbers(&case["fixed"])).for_each(|(found, expected)| near(found, expected));
        near(curve.f1_max(), case["max"].as_f64().unwrap());
    }
}

/// Everything of a map and its sigma, under the key that tables and files have.
#[test]
fn scores() {
    let r = Reference::read();
    let subject = Subject::new(r.prediction.view(), r.truth.view()).with_sigma(r.sigma.view());
    let scores =
        score(&subject, &ScoreConfig { alignment: AlignmentRule::Median, ..ScoreConfig::default() }).unwrap();
    let Alignment::Depth { scale, .. } = scores.alignment else { panic!() };
    near(scale, r.value("median"));
    assert_eq!(scores.pixels, r.mask.iter().filter(|&&m| m).count());
    let value = |key: &str| scores.get(key).unwrap_or_else(|| panic!("no {key}"));
    for key in ["mse", "rmse", "abs_rel", "sq_rel", "rmse_log", "log10", "silog", "irmse", "boundary_f1"] {
        near(value(key), r.value(&key.replace('_', "-")));
    }
    for (keys, name) in [
        (&["delta1", "delta2", "delta3"][..], "delta"),
        (&["dbe_accuracy", "dbe_completeness"], "dbe"),
        (&["coverage_50", "coverage_68", "coverage_90", "coverage_95"], "coverage"),
    ] {
        keys.iter().zip(r.values(name)).for_each(|(key, expected)| near(value(key), expected));
    }
    for case in r.expected["edges"].as_array().unwrap() {
        let threshold = case["threshold"].as_f64().unwrap();
        if case["tolerance"] == 1 && threshold < 1.0 {
            near(value(&format!("f1@{threshold}m_r1")), numbers(&case["fixed"])[2]);
            near(value(&format!("f1_max@{threshold}m_r1")), case["max"].as_f64().unwrap());
        }
    }
    // Gradients, and sigmas on the way, are kept in 32 bits, which moves the last digits.
    let close = |key: &str, expected: f64| {
        assert_relative_eq!(value(key), expected, max_relative = 1e-6);
    };
    for key in ["spearman", "nll", "mean_z2"] {
        close(key, r.value(&key.replace('_', "-")));
    }
    for (key, name) in [("ause_mae", "rays-mae"), ("ause_rmse", "rays-rmse")] {
        close(key, r.value(name));
    }
    let keys = ["sharpness", "sharpness_on", "sharpness_off"];
    keys.iter().zip(r.values("sharpness")).for_each(|(key, expected)| close(key, expected));
}

/// What no score has by itself. The map is so small that every pixel is a superpixel.
#[test]
fn boundaries_order_and_ties() {
    let r = Reference::read();
    let (p, g, m) = (r.aligned.view(), r.truth.view(), r.mask.view());
    let canny: Vec<Vec<usize>> = serde_json::from_value(r.expected["canny"].clone()).unwrap();
    for (map, expected) in [p, g].into_iter().zip(canny) {
        let found = dbe::boundaries(map, m).unwrap().pixels;
        let at = found.iter().enumerate().filter(|(_, e)| **e).map(|(k, _)| k).collect::<Vec<_>>();
        assert_eq!(at, expected);
    }
    let pairs = SuperpixelPairs::new(g, m).unwrap();
    near(d3r(r.sigma.view(), &pairs).unwrap().unwrap(), r.value("d3r"));
    assert_eq!(d3r(p, &pairs).unwrap(), Some(0.0));

    let sigma: Vec<f64> = r.list(&r.sigma).iter().map(|s| s * r.value("median")).collect();
    let errors: Vec<f64> = r.list(&r.aligned).iter().zip(r.list(&r.truth)).map(|(p, g)| p - g).collect();
    // Quadrature on the other side.
    let crps = calibration::crps(&errors[..40], &sigma[..40]).unwrap();
    assert_relative_eq!(crps, r.value("crps-first"), max_relative = 1e-6);
    let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    let rough: Vec<f64> = sigma.iter().map(|s| (s * 100.0).round_ties_even() / 100.0).collect();
    near(spearman(&rough, &absolute).unwrap().unwrap(), r.value("spearman-ties"));
    let ranks = average_ranks(&rough).unwrap();
    near(ranks.iter().enumerate().map(|(k, rank)| k as f64 * rank).sum(), r.value("ranks-ties"));
}
