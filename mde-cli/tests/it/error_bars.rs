//! Calibrations and intervals.

use crate::common::{Place, REFINE, fixture, names, tiny};
use mde_cli::refiner::calibration;

const LEARN: &str = "calibrate --dataset rooms --size 64x48 --limit 3 --simulated model -o learned";

/// And so the parts of sigma, whose root sum of squares it stays.
#[test]
fn what_was_learned_scales_sigma_and_makes_the_interval() {
    let place = Place::new();
    assert!(place.run(LEARN).contains("on held-out scenes"));
    for file in ["calibration.toml", "scenes.csv", "summary.json", "report.html"] {
        assert!(place.has(&format!("learned/{file}")), "{file}");
    }
    let calibration = calibration::read(&place.path("learned/calibration.toml")).unwrap();
    assert_eq!((calibration.scenes().len(), calibration.held_out().len()), (3, 4));

    place.run(&format!("{REFINE} -o plain"));
    let options = "--calibration learned/calibration.toml --interval 0.8";
    let [said, told] = place.told(&format!("{REFINE} {options} -o scaled"), 0);
    assert!(told.contains("other settings"), "{told}");
    assert!(said.contains("lower.npy and upper.npy: 80 % interval, the depth -+ "), "{said}");
    assert!(said.contains(" sigma, by learned/calibration.toml"), "{said}");
    let factor = calibration.intervals().unwrap().factor(0.9).unwrap() as f32;
    let half_width = calibration.intervals().unwrap().half_width(0.8).unwrap() as f32;
    let [depth, sigma, lower, upper] =
        ["depth", "sigma", "lower", "upper"].map(|name| place.map(&format!("scaled/{name}.npy")));
    assert_eq!(depth, place.map("plain/depth.npy"));
    for (pixel, before) in place.map("plain/sigma.npy").indexed_iter() {
        assert!((sigma[pixel] / before - factor).abs() < 1e-4 * factor);
        let reach = half_width * before;
        assert!((upper[pixel] - depth[pixel] - reach).abs() < 1e-4 * (depth[pixel] + reach));
        assert!((lower[pixel] - (depth[pixel] - reach).max(0.0)).abs() < 1e-4 * (depth[pixel] + reach));
    }
    let record = place.record("scaled");
    let common = record["augmentation"]["common_error"].as_f64().unwrap();
    assert!((common / (0.12 * f64::from(factor)) - 1.0).abs() < 1e-4, "{common} {factor}");
    assert_eq!(record["error_bar"]["interval"]["probability"], 0.8);
    assert_eq!(record["error_bar"]["interval"]["by"], "learned/calibration.toml");

    if cfg!(feature = "onnx") {
        place.take(fixture("grey_nchw.onnx"), "net.onnx");
        place.write("net.toml", "width = 32\nheight = 24\noutput = 'metric'\n");
        let model = "--prior-model net.onnx --fov 60 --export sigma";
        place.run(&format!("refine image.png {model} --calibration learned/calibration.toml -o out"));
        let factor = place.record("out")["error_bar"]["factor"].as_f64().unwrap();
        assert!((factor - 1.0).abs() > 0.05, "{factor}");
        let parts =
            ["common", "spread", "disagreement"].map(|name| place.map(&format!("out/sigma/{name}.npy")));
        for (pixel, whole) in place.map("out/sigma.npy").indexed_iter() {
            let sum = parts.iter().map(|part| part[pixel].powi(2)).sum::<f32>().sqrt();
            assert!((sum / whole - 1.0).abs() < 1e-3, "{sum} {whole} {factor}");
        }
    }
}

#[test]
fn a_calibration_for_a_map_from_a_file_warns_that_its_network_is_unknown() {
    let place = Place::new();
    place.write("tiny.toml", tiny(&[("steps = 60", "steps = 5")]));
    place.run(&LEARN.replace("--simulated model", "--method tiny.toml -q"));
    let told = place.run(&format!("{REFINE} --calibration learned/calibration.toml -o out"));
    assert!(told.contains("does not name its network") && !told.contains("other settings"), "{told}");
}

/// And what sigma is made of is exported part by part.
#[test]
fn an_interval_without_a_calibration_is_normal_and_says_so() {
    let place = Place::new();
    let told = place.run(&format!("{REFINE} --interval 0.5 --export sigma -o out"));
    assert!(told.contains("normal distribution"), "{told}");
    let half_width = place.record("out")["error_bar"]["interval"]["half_width"].as_f64().unwrap();
    assert!((half_width - 0.674_489_75).abs() < 1e-6 && place.has("out/lower.npy"));
    assert_eq!(names(&place.path("out/sigma")), ["common.npy", "field.npy"]);
    assert_eq!(place.map("out/sigma/field.npy").dim(), place.map("out/depth.npy").dim());
}
