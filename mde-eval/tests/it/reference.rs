//! Against SciPy, scikit-image, scikit-learn and NumPy: `reference/metrics.py` made `reference/metrics.json`.

use approx::assert_relative_eq;
use mde_eval::align::{Alignment, AlignmentRule};
use mde_eval::metrics::edges::{edge_curve, edges};
use mde_eval::metrics::sparsification::{Reduction, sparsify, sparsify_poggi};
use mde_eval::metrics::superpixel::SuperpixelPairs;
use mde_eval::metrics::{boundary, calibration, dbe, depth, rank, sharpness};
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
        let map = |name: &str| {
            let rows: Vec<Vec<f64>> = serde_json::from_value(file["inputs"][name].clone()).unwrap();
            Array2::from_shape_fn((rows.len(), rows[0].len()), |(y, x)| rows[y][x] as f32)
        };
        let (prediction, truth, sigma) = (map("prediction"), map("truth"), map("sigma"));
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

    fn errors(&self) -> Vec<f64> {
        self.list(&self.aligned).iter().zip(self.list(&self.truth)).map(|(p, g)| p - g).collect()
    }

    fn scaled_sigma(&self) -> Vec<f64> {
        self.list(&self.sigma).iter().map(|s| s * self.value("median")).collect()
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
    let fit = r.values("ls-depth");
    let Alignment::Depth { scale, shift } = AlignmentRule::LeastSquaresDepth.fit(&p, &g).unwrap() else {
        panic!()
    };
    near(scale, fit[0]);
    near(shift, fit[1]);
    let fit = r.values("ls-disparity");
    let alignment = AlignmentRule::LeastSquaresDisparity.fit(&p, &g).unwrap();
    let Alignment::Disparity { scale, shift, .. } = alignment else { panic!() };
    near(scale, fit[0]);
    near(shift, fit[1]);
    let aligned: Vec<f64> = p.iter().map(|&p| alignment.depth(p)).collect();
    near(depth::rmse(&aligned, &g).unwrap(), r.value("ls-disparity-rmse"));
}

#[test]
fn depth_errors() {
    let r = Reference::read();
    let (p, g) = (r.list(&r.aligned), r.list(&r.truth));
    type Metric = fn(&[f64], &[f64]) -> mde_eval::Result<f64>;
    let metrics: [(&str, Metric); 8] = [
        ("mse", depth::mse),
        ("rmse", depth::rmse),
        ("abs-rel", depth::abs_rel),
        ("sq-rel", depth::sq_rel),
        ("rmse-log", depth::rmse_log),
        ("log10", depth::log10),
        ("silog", depth::silog),
        ("irmse", depth::irmse),
    ];
    for (name, metric) in metrics {
        near(metric(&p, &g).unwrap(), r.value(name));
    }
    for (k, expected) in (1..).zip(r.values("delta")) {
        near(depth::delta(&p, &g, k).unwrap(), expected);
    }
}

#[test]
fn edge_scores() {
    let r = Reference::read();
    let (p, g, m) = (r.aligned.view(), r.truth.view(), r.mask.view());
    for case in r.expected["edges"].as_array().unwrap() {
        let threshold = case["threshold"].as_f64().unwrap();
        let tolerance = case["tolerance"].as_u64().unwrap() as u32;
        let curve = edge_curve(p, g, m, threshold, tolerance).unwrap().unwrap();
        let found = curve.at(threshold);
        for (found, expected) in
            [found.precision, found.recall, found.f1].into_iter().zip(numbers(&case["fixed"]))
        {
            near(found, expected);
        }
        near(curve.f1_max(), case["max"].as_f64().unwrap());
    }
}

#[test]
fn sharpness_and_boundary() {
    let r = Reference::read();
    let (p, g, m) = (r.aligned.view(), r.truth.view(), r.mask.view());
    let band = edges(g, m, 0.5).unwrap();
    let split = sharpness::sharpness_by_edges(p, m, band.view(), 3.0).unwrap();
    let found = [sharpness::sharpness(p, m).unwrap(), split.on.unwrap(), split.off.unwrap()];
    for (found, expected) in found.into_iter().zip(r.values("sharpness")) {
        // Gradients are kept in 32 bits.
        assert_relative_eq!(found, expected, max_relative = 1e-6);
    }
    near(boundary::boundary_f1(p, g, m).unwrap(), r.value("boundary-f1"));
}

#[test]
fn boundaries_and_their_distances() {
    let r = Reference::read();
    let (p, g, m) = (r.aligned.view(), r.truth.view(), r.mask.view());
    let found = [p, g].map(|map| dbe::boundaries(map, m).unwrap());
    let canny: Vec<Vec<usize>> = serde_json::from_value(r.expected["canny"].clone()).unwrap();
    for (found, expected) in found.iter().zip(canny) {
        let at = found.iter().enumerate().filter(|(_, e)| **e).map(|(k, _)| k).collect::<Vec<_>>();
        assert_eq!(at, expected);
    }
    let errors = dbe::boundary_errors(found[0].view(), found[1].view()).unwrap().unwrap();
    near(errors.accuracy, r.values("dbe")[0]);
    near(errors.completeness, r.values("dbe")[1]);
}

/// The map is so small that every pixel is a superpixel.
#[test]
fn order_of_superpixels() {
    let r = Reference::read();
    let pairs = SuperpixelPairs::new(r.truth.view(), r.mask.view()).unwrap();
    near(pairs.d3r(r.sigma.view()).unwrap().unwrap(), r.value("d3r"));
    assert_eq!(pairs.d3r(r.aligned.view()).unwrap(), Some(0.0));
}

#[test]
fn ranks_and_sparsification() {
    let r = Reference::read();
    let (sigma, errors, truth) = (r.scaled_sigma(), r.errors(), r.list(&r.truth));
    let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    let squared: Vec<f64> = errors.iter().map(|e| e * e).collect();
    let relative: Vec<f64> = absolute.iter().zip(&truth).map(|(e, g)| e / g).collect();
    near(rank::spearman(&sigma, &absolute).unwrap().unwrap(), r.value("spearman"));
    let rough: Vec<f64> = sigma.iter().map(|s| (s * 100.0).round_ties_even() / 100.0).collect();
    near(rank::spearman(&rough, &absolute).unwrap().unwrap(), r.value("spearman-ties"));
    let ranks = rank::average_ranks(&rough).unwrap();
    near(ranks.iter().enumerate().map(|(k, rank)| k as f64 * rank).sum(), r.value("ranks-ties"));
    near(sparsify(&absolute, &sigma, Reduction::Mean).unwrap().ause(), r.value("rays-mae"));
    near(sparsify(&squared, &sigma, Reduction::RootMean).unwrap().ause(), r.value("rays-rmse"));
    for (costs, reduction, name) in
        [(&relative, Reduction::Mean, "poggi-abs-rel"), (&squared, Reduction::RootMean, "poggi-rmse")]
    {
        let curves = sparsify_poggi(costs, &sigma, reduction).unwrap();
        near(curves.ause(), r.values(name)[0]);
        near(curves.aurg(), r.values(name)[1]);
    }
    let prediction = r.list(&r.aligned);
    let outlier = |(p, g): (&f64, &f64)| f64::from(u8::from((p / g).max(g / p) >= 1.25));
    let outliers: Vec<f64> = prediction.iter().zip(&truth).map(outlier).collect();
    let curves = sparsify_poggi(&outliers, &sigma, Reduction::Mean).unwrap();
    near(curves.aurg(), r.value("poggi-a1-aurg"));
    near(curves.ause(), r.value("poggi-a1-ause"));
}

#[test]
fn calibration_scores() {
    let r = Reference::read();
    let (e, s) = (r.errors(), r.scaled_sigma());
    near(calibration::nll(&e, &s).unwrap(), r.value("nll"));
    // Quadrature on the other side.
    assert_relative_eq!(
        calibration::crps(&e[..40], &s[..40]).unwrap(),
        r.value("crps-first"),
        max_relative = 1e-6
    );
    for (level, expected) in [0.5, 0.68, 0.9, 0.95].into_iter().zip(r.values("coverage")) {
        near(calibration::coverage(&e, &s, level).unwrap(), expected);
    }
    let errors = calibration::calibration_errors(&e, &s).unwrap();
    near(errors.mean, r.value("mace"));
    near(errors.root_mean_square, r.value("rmsce"));
    assert_relative_eq!(errors.area, r.value("miscalibration-area"), max_relative = 1e-6);
    near(calibration::ence(&e, &s, 20).unwrap(), r.value("ence"));
    near(calibration::mean_z2(&e, &s).unwrap(), r.value("mean-z2"));
    near(calibration::rms_sigma(&e, &s).unwrap(), r.value("rms-sigma"));
}

/// The scores are made of the same functions.
#[test]
fn the_scores_agree() {
    let r = Reference::read();
    let subject = Subject::new(r.prediction.view(), r.truth.view()).with_sigma(r.sigma.view());
    let scores = score(&subject, &ScoreConfig::default()).unwrap();
    let Alignment::Depth { scale, .. } = scores.alignment else { panic!() };
    near(scale, r.value("median"));
    assert_eq!(scores.pixels, r.mask.iter().filter(|&&m| m).count());
    let value = |key: &str| scores.get(key).unwrap_or_else(|| panic!("no {key}"));
    near(value("abs_rel"), r.value("abs-rel"));
    near(value("delta2"), r.values("delta")[1]);
    near(value("boundary_f1"), r.value("boundary-f1"));
    near(value("dbe_completeness"), r.values("dbe")[1]);
    assert_eq!(value("d3r"), 0.0);
    for case in r.expected["edges"].as_array().unwrap() {
        let threshold = case["threshold"].as_f64().unwrap();
        if case["tolerance"] == 1 && threshold < 1.0 {
            near(value(&format!("f1@{threshold}m_r1")), numbers(&case["fixed"])[2]);
            near(value(&format!("f1_max@{threshold}m_r1")), case["max"].as_f64().unwrap());
        }
    }
    // Sigmas are kept in 32 bits on the way, which may swap no ranks here but moves the last digits.
    for (key, name) in [
        ("nll", "nll"),
        ("spearman", "spearman"),
        ("ause_mae", "rays-mae"),
        ("ence", "ence"),
        ("mean_z2", "mean-z2"),
        ("rmsce", "rmsce"),
    ] {
        assert_relative_eq!(value(key), r.value(name), max_relative = 1e-6);
    }
    assert_relative_eq!(value("poggi_aurg_abs_rel"), r.values("poggi-abs-rel")[1], max_relative = 1e-6);
}
