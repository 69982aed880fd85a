//! Scores of predictions of known quality.

use mde_eval::align::{Alignment, AlignmentRule};
use mde_eval::mde_uncertainty::random::CounterRng;
use mde_eval::ndarray::{Array2, Zip};
use mde_eval::scene::{Room, room};
use mde_eval::score::{ScoreConfig, Scores, Subject, TruthCache, score, score_aligned};
use proptest::prelude::*;
use rand_distr::{Distribution, StandardNormal};

const RULES: [AlignmentRule; 5] = [
    AlignmentRule::None,
    AlignmentRule::Median,
    AlignmentRule::MedianRatio,
    AlignmentRule::LeastSquaresDepth,
    AlignmentRule::LeastSquaresDisparity,
];

fn study() -> Array2<f32> {
    room(Room::Study, 0, 160, 120).unwrap().depth
}

fn scored(prediction: &Array2<f32>, truth: &Array2<f32>, alignment: AlignmentRule) -> Scores {
    let config = ScoreConfig { alignment, ..ScoreConfig::default() };
    score(&Subject::new(prediction.view(), truth.view()), &config).unwrap()
}

fn normal(index: usize) -> f64 {
    StandardNormal.sample(&mut CounterRng::new(11, "score-test", 0, index as u64))
}

#[test]
fn a_perfect_prediction_scores_perfectly_under_every_rule() {
    let truth = study();
    for rule in RULES {
        let scores = scored(&truth, &truth, rule);
        let value = |key: &str| scores.get(key).unwrap_or_else(|| panic!("{rule}: no {key}"));
        for (key, most) in [
            ("rmse", 1e-5),
            ("abs_rel", 1e-6),
            ("silog", 1e-4),
            ("dbe_accuracy", 0.05),
            ("dbe_completeness", 0.05),
            ("d3r", 0.0),
        ] {
            assert!(value(key) <= most, "{rule}: {key} {}", value(key));
        }
        for key in ["delta1", "delta2", "delta3"] {
            assert_eq!(value(key), 1.0);
        }
        for key in ["f1@0.25m_r1", "f1_max@0.25m_r1", "f1_max@0.5m_r1", "boundary_f1"] {
            assert!(value(key) > 0.999, "{rule}: {key} {}", value(key));
        }
    }
}

#[test]
fn the_true_sigma_is_calibrated_and_points_at_the_errors() {
    let truth = study();
    let sigma = Array2::from_shape_fn(truth.dim(), |(y, x)| 0.01 + 0.002 * ((x * 7 + y * 13) % 40) as f32);
    let mut prediction = truth.clone();
    for (index, (p, s)) in prediction.iter_mut().zip(&sigma).enumerate() {
        *p += (normal(index) * f64::from(*s)) as f32;
    }
    let subject = Subject::new(prediction.view(), truth.view()).with_sigma(sigma.view());
    let config = ScoreConfig { alignment: AlignmentRule::None, ..ScoreConfig::default() };
    let scores = score(&subject, &config).unwrap();
    let value = |key: &str| scores.get(key).unwrap();
    for nominal in [0.5, 0.68, 0.9, 0.95] {
        // Four standard errors.
        let spread = f64::sqrt(nominal * (1.0 - nominal) / scores.pixels as f64);
        let observed = value(&format!("coverage_{:.0}", 100.0 * nominal));
        assert!((observed - nominal).abs() < 4.0 * spread, "{nominal}: {observed}");
    }
    assert!((value("mean_z2") - 1.0).abs() < 4.0 * (2.0 / scores.pixels as f64).sqrt());
    assert!(value("spearman") > 0.3 && value("spearman_binned") > 0.9);
    let none = Array2::from_elem(truth.dim(), 0.05);
    let flat = score(&subject.with_sigma(none.view()), &config).unwrap();
    assert_eq!(flat.get("spearman"), None);
    for key in ["nll", "crps", "ause_mae"] {
        assert!(flat.get(key).unwrap() > value(key), "{key}");
    }
}

#[test]
fn a_sigma_proportional_to_depth_is_at_chance_where_errors_are_relative() {
    let truth = study();
    let mut index = 0;
    // The relative error is larger on the left half; it does not depend on depth.
    let share = Array2::from_shape_fn(truth.dim(), |(_, x)| if x < 80 { 0.1 } else { 0.02 });
    let prediction = Zip::from(&truth).and(&share).map_collect(|&g, &share| {
        index += 1;
        g * (1.0 + share * normal(index) as f32).max(0.1)
    });
    let scores = |sigma: &Array2<f32>| {
        let subject = Subject::new(prediction.view(), truth.view()).with_sigma(sigma.view());
        score_aligned(&subject, &Alignment::IDENTITY, &ScoreConfig::default()).unwrap().values
    };
    let [by_depth, right] = [scores(&(&prediction * 0.25)), scores(&(&prediction * &share))];
    assert!(by_depth["aurg_relative"].abs() < 0.02, "{by_depth:?}");
    assert!(right["aurg_relative"] > 0.1 && right["ause_relative"] < by_depth["ause_relative"], "{right:?}");
    assert!(right["spearman_relative"] > 0.4, "{right:?}");
    // A sigma that ranks the relative errors exactly.
    let error = Zip::from(&prediction).and(&truth).map_collect(|p, g| (p - g).abs());
    let exact = Zip::from(&prediction).and(&truth).and(&error).map_collect(|p, g, e| p * (e / g + 1e-6));
    let exact = scores(&exact);
    assert!(exact["spearman_relative"] > 0.999 && exact["ause_relative"].abs() < 1e-3, "{exact:?}");
}

#[test]
fn shared_and_own_alignment_differ_as_they_should() {
    let truth = study();
    let (baseline, other) = (truth.mapv(|z| 0.5 * z), truth.mapv(|z| 0.55 * z));
    let shared = scored(&baseline, &truth, AlignmentRule::Median).alignment;
    let subject = Subject::new(other.view(), truth.view());
    let under = |alignment| score_aligned(&subject, alignment, &ScoreConfig::default()).unwrap();
    assert!((under(&shared).values["abs_rel"] - 0.1).abs() < 1e-5);
    assert_eq!(under(&shared).rule, None);
    assert!(scored(&other, &truth, AlignmentRule::Median).values["abs_rel"] < 1e-6);
}

/// Whichever prediction comes first, and whatever pixels it leaves.
#[test]
fn a_cache_of_the_truth_changes_no_score() {
    let (truth, cache, config) = (study(), TruthCache::default(), ScoreConfig::default());
    let mut holes = truth.clone();
    holes.row_mut(60).fill(0.0);
    for prediction in [truth.mapv(|z| z.powf(0.9)), holes, truth.mapv(|z| z.powf(1.1))] {
        let alone = Subject::new(prediction.view(), truth.view());
        let cached = Subject { cache: Some(&cache), ..alone };
        assert_eq!(score(&cached, &config).unwrap(), score(&alone, &config).unwrap());
    }
}

#[test]
fn missing_pixels_masks_and_crops_do_not_count() {
    let truth = study();
    let mut prediction = truth.clone();
    prediction.row_mut(0).fill(f32::NAN);
    prediction.row_mut(1).fill(0.0);
    prediction.row_mut(2).fill(-3.0);
    let mut holes = truth.clone();
    holes.column_mut(0).fill(0.0);
    let (height, width) = truth.dim();
    let whole = scored(&prediction, &holes, AlignmentRule::None);
    assert_eq!(whole.pixels, (height - 3) * (width - 1));
    assert!(whole.values["rmse"] < 1e-6);

    let mut mask = Array2::from_elem(truth.dim(), true);
    mask.row_mut(10).fill(false);
    let subject = Subject { mask: Some(mask.view()), ..Subject::new(prediction.view(), holes.view()) };
    let config = ScoreConfig { crop: Some([5, 25, 30, 70]), ..ScoreConfig::default() };
    assert_eq!(score(&subject, &config).unwrap().pixels, 19 * 40);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever the maps hold, there is a score or an error, and every number is one.
    #[test]
    fn nothing_panics(
        (height, width, pixels) in (1..9_usize, 1..9_usize).prop_flat_map(|(h, w)| {
            let value = prop_oneof![
                4 => 0.1..9.0_f32, 1 => Just(0.0), 1 => Just(f32::NAN), 1 => Just(f32::INFINITY), 1 => any::<f32>()
            ];
            let pixel = (value.clone(), value.clone(), value);
            (Just(h), Just(w), proptest::collection::vec(pixel, h * w))
        }),
        rule in 0..5_usize,
    ) {
        let map = |of: fn(&(f32, f32, f32)) -> f32| {
            Array2::from_shape_vec((height, width), pixels.iter().map(of).collect()).unwrap()
        };
        let (p, g, s) = (map(|v| v.0), map(|v| v.1), map(|v| v.2));
        let config = ScoreConfig { alignment: RULES[rule], ..ScoreConfig::default() };
        if let Ok(scores) = score(&Subject::new(p.view(), g.view()).with_sigma(s.view()), &config) {
            prop_assert!(scores.values.contains_key("mse") && scores.values.contains_key("boundary_f1"));
            prop_assert!(scores.values.values().all(|value| value.is_finite()));
            let within = |keys: &[&str], most: f64| {
                let mut values = keys.iter().filter_map(|key| scores.get(key));
                // Weights add up to 1 but for rounding.
                values.all(|value| (-1e-9..=most + 1e-9).contains(&value))
            };
            prop_assert!(within(&["dbe_accuracy", "dbe_completeness"], 10.0), "{scores:?}");
            prop_assert!(within(&["d3r", "f1_max@0.5m_r1", "coverage_90", "ause_mae"], 1.0), "{scores:?}");
        }
    }
}
