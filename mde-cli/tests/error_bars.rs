//! Calibrations and intervals through the built program.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, names};
use mde_cli::mde_prior::format::{ReadOptions, read_depth};
use mde_cli::refiner::calibration;
use ndarray::Array2;
use serde_json::Value;
use std::fs;

fn map(place: &Place, path: &str) -> Array2<f32> {
    read_depth(place.path(path), &ReadOptions::default()).unwrap()
}

fn record(place: &Place, folder: &str) -> Value {
    serde_json::from_slice(&fs::read(place.path(folder).join("run.json")).unwrap()).unwrap()
}

const REFINE: &str = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml";

#[test]
fn what_was_learned_scales_sigma_and_makes_the_interval() {
    let place = Place::new();
    let learn = "calibrate --dataset rooms --size 64x48 --limit 3 --simulated-model all -o learned";
    let learned = place.mde(learn).assert().success();
    assert!(String::from_utf8_lossy(&learned.get_output().stderr).contains("on held-out scenes"));
    for file in ["calibration.toml", "scenes.csv", "summary.json", "report.html"] {
        assert!(names(&place.path("learned")).contains(&file.to_owned()), "{file}");
    }
    let calibration = calibration::read(&place.path("learned/calibration.toml")).unwrap();
    assert_eq!((calibration.scenes().len(), calibration.held_out().len()), (3, 4));

    place.mde(&format!("{REFINE} -o plain")).assert().success();
    let options = "--calibration learned/calibration.toml --interval 0.8";
    let scaled = place.mde(&format!("{REFINE} {options} -o scaled")).assert().success();
    assert!(String::from_utf8_lossy(&scaled.get_output().stderr).contains("other settings"));
    let said = String::from_utf8_lossy(&scaled.get_output().stdout).into_owned();
    assert!(said.contains("lower.npy and upper.npy: 80 % interval, the depth -+ "), "{said}");
    assert!(said.contains(" sigma, by learned/calibration.toml"), "{said}");
    let factor = calibration.intervals().unwrap().factor(0.9).unwrap() as f32;
    let half_width = calibration.intervals().unwrap().half_width(0.8).unwrap() as f32;
    let (depth, sigma) = (map(&place, "scaled/depth.npy"), map(&place, "scaled/sigma.npy"));
    assert_eq!(depth, map(&place, "plain/depth.npy"));
    let (lower, upper) = (map(&place, "scaled/lower.npy"), map(&place, "scaled/upper.npy"));
    for (pixel, before) in map(&place, "plain/sigma.npy").indexed_iter() {
        assert!((sigma[pixel] / before - factor).abs() < 1e-4 * factor);
        let reach = half_width * before;
        assert!((upper[pixel] - depth[pixel] - reach).abs() < 1e-4 * (depth[pixel] + reach));
        assert!((lower[pixel] - (depth[pixel] - reach).max(0.0)).abs() < 1e-4 * (depth[pixel] + reach));
    }
    let record = record(&place, "scaled");
    let common = record["augmentation"]["common_error"].as_f64().unwrap();
    assert!((common / (0.12 * f64::from(factor)) - 1.0).abs() < 1e-4, "{common} {factor}");
    assert_eq!(record["error_bar"]["interval"]["probability"], 0.8);
    assert_eq!(record["error_bar"]["interval"]["by"], "learned/calibration.toml");
}

#[test]
fn a_calibration_for_a_map_from_a_file_warns_that_its_network_is_unknown() {
    let place = Place::new();
    place
        .mde("calibrate --dataset rooms --size 64x48 --limit 3 --method tiny.toml -q -o learned")
        .assert()
        .success();
    let told =
        place.mde(&format!("{REFINE} --calibration learned/calibration.toml -o out")).assert().success();
    let told = String::from_utf8_lossy(&told.get_output().stderr).into_owned();
    assert!(told.contains("does not name its network") && !told.contains("other settings"), "{told}");
}

#[test]
fn an_interval_without_a_calibration_is_normal_and_says_so() {
    let place = Place::new();
    let told = place.mde(&format!("{REFINE} --interval 0.5 -o out")).assert().success();
    assert!(String::from_utf8_lossy(&told.get_output().stderr).contains("normal distribution"));
    let interval = record(&place, "out")["error_bar"]["interval"].clone();
    assert!((interval["half_width"].as_f64().unwrap() - 0.674_489_75).abs() < 1e-6);
    assert!(names(&place.path("out")).contains(&"lower.npy".to_owned()));
}

#[test]
fn the_interval_of_a_disparity_warns_of_the_assumed_range() {
    let place = Place::new();
    for (kind, warned) in [("disparity", true), ("metric", false)] {
        let options = format!("--prior-kind {kind} --interval 0.9 -o {kind}");
        let told = place.mde(&format!("{REFINE} {options}")).assert().success();
        let told = String::from_utf8_lossy(&told.get_output().stderr).into_owned();
        assert_eq!(told.contains("depth range assumed for disparities"), warned, "{told}");
    }
}

/// Their root sum of squares is sigma, with a calibration too.
#[cfg(feature = "onnx")]
#[test]
fn a_calibration_scales_the_parts_of_sigma_too() {
    let place = Place::new();
    let learn = "calibrate --dataset rooms --size 64x48 --limit 3 --simulated-model all -q -o learned";
    place.mde(learn).assert().success();
    let net = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures/grey_nchw.onnx");
    let model = format!("--prior-model {net} --input-size 32x24 --prior-kind metric");
    let calibrated = "--calibration learned/calibration.toml --export sigma -o out";
    place.mde(&format!("refine image.png {model} --fov 60 {calibrated}")).assert().success();
    let factor = record(&place, "out")["error_bar"]["factor"].as_f64().unwrap();
    assert!((factor - 1.0).abs() > 0.05, "{factor}");
    let [common, spread, disagreement, sigma] =
        ["sigma/common", "sigma/spread", "sigma/disagreement", "sigma"]
            .map(|name| map(&place, &format!("out/{name}.npy")));
    for (pixel, whole) in sigma.indexed_iter() {
        let parts = [&common, &spread, &disagreement].map(|part| part[pixel].powi(2));
        let sum = parts.iter().sum::<f32>().sqrt();
        assert!((sum / whole - 1.0).abs() < 1e-3, "{sum} {whole} {factor}");
    }
}

/// What sigma is made of is exported part by part.
#[test]
fn the_parts_of_sigma_are_files() {
    let place = Place::new();
    place.mde(&format!("{REFINE} --export sigma -o out")).assert().success();
    assert_eq!(names(&place.path("out/sigma")), ["common.npy", "field.npy"]);
    assert_eq!(map(&place, "out/sigma/field.npy").dim(), map(&place, "out/depth.npy").dim());
}
