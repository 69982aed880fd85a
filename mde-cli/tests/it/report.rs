//! The reports, and the program's own help: completions, manual pages, the doctor.

use crate::common::{HEIGHT, Place, WIDTH, names, shared};
use serde_json::{Value, json};
use std::fs;

/// What the page holds. It loads nothing: the only address in it is the name of the SVG namespace.
pub(crate) fn data(html: &str) -> Value {
    assert!(html.contains("default-src 'none'"));
    assert_eq!(html.matches("://").count(), html.matches("http://www.w3.org/2000/svg").count());
    assert_eq!(html.matches("<script").count(), 2);
    assert!(!html.contains("<link") && !html.contains("@import") && !html.contains("{{"));
    let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..end]).unwrap()
}

#[test]
fn a_run_has_a_report_that_can_be_made_again() {
    let place = Place::new();
    place.take("image.png", "a 'b.png");
    let refine =
        "refine --preset paper --prior-depth depth.npy --fov 60 --config tiny.toml --gt depth.npy -o out";
    let run = place.mde(refine).arg("a 'b.png").assert().success();
    assert!(String::from_utf8_lossy(&run.get_output().stdout).contains("open out/report.html"));
    let html = place.text("out/report.html");
    let data = data(&html);
    assert_eq!((data["kind"].as_str(), data["title"].as_str()), (Some("run"), Some("a 'b.png")));
    assert_eq!(data["size"], json!([WIDTH, HEIGHT]));
    for map in ["prior", "refined", "sigma", "truth"] {
        assert!(data["maps"][map]["data"].as_str().unwrap().len() > 20, "{map}");
    }
    assert!(data["prior_error"].as_array().unwrap().iter().any(|error| error.as_f64().unwrap() > 0.0));
    let record = &data["record"];
    assert!(record["command_line"].as_str().unwrap().ends_with(r"-o out 'a '\''b.png'"));
    let curves = record["training"].as_array().unwrap();
    assert_eq!(curves.len(), record["iterations"].as_array().unwrap().len());
    for curve in curves {
        let [step, loss, psnr] = ["step", "loss", "psnr"].map(|key| curve[key].as_array().unwrap());
        assert!(step.len() > 1 && step.len() == loss.len() && step.len() == psnr.len());
        assert_eq!(step.last().unwrap().as_u64(), Some(60));
        assert!(psnr.last().unwrap().as_f64() > psnr[0].as_f64());
    }

    let before = names(&place.path("out"));
    fs::remove_file(place.path("out/report.html")).unwrap();
    let [said, _] = place.told("report out", 0);
    assert!(said.contains("out/report.html") && place.text("out/report.html") == html, "{said}");
    assert_eq!(names(&place.path("out")), before);

    // A folder without a report is told in one line.
    place.run("warp image.png --prior-depth depth.npy --fov 60 -q -o views");
    fs::remove_file(place.path("out/image.png")).unwrap();
    for (folder, named) in [
        ("none", &["none", "run.json", "summary.json"][..]),
        ("views", &["views", "mde warp", "mde refine"]),
        ("out", &["image.png", "run the refinement again"]),
    ] {
        let [said, told] = place.told(&format!("report {folder}"), 1);
        assert!(said.is_empty() && told.lines().count() == 1, "{said} {told}");
        assert!(named.iter().all(|word| told.contains(word)), "{told}");
    }
}

#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn the_doctor_tries_a_model() {
    let place = Place::new();
    let path = |name: &str| shared().join(name).display().to_string();
    let model = path("models/fastdepth/fastdepth_224.onnx");
    let small = path("models/upydnet_nyu48/model.onnx");
    place.write("small.toml", "width = 48\nheight = 48\noutput = 'metric'\n");
    place.take(&model, "model.onnx");
    let tried = "runtime tract: ;default needs 30 predictions;\"width\":224;\"output\":\"metric\"";
    let exchanged = "near and far are exchanged";
    for (arguments, code, words) in [
        (model.clone(), 0, tried),
        // Under another name its layers tell it.
        ("model.onnx".to_owned(), 0, tried),
        (format!("{model} --model-profile midas-v2.1-small"), 1, exchanged),
        (format!("{small} --model-profile small.toml --prior-kind disparity"), 0, "works here"),
        (format!("{small} --model-profile small.toml --prior-kind metric"), 1, "give --prior-kind disparity"),
    ] {
        let [said, told] = place.told(&format!("doctor --prior-model {arguments}"), code);
        let text = [said.split_whitespace().collect::<Vec<_>>().join(" "), told].concat();
        assert!(words.split(';').all(|word| text.contains(word)), "{arguments}: {text}");
        assert_eq!(text.contains("verdict the model works here"), code == 0, "{arguments}: {text}");
        // A refinement warns of the same.
        let photograph = path("data/plain/nyu_00000/color.jpg");
        let refine =
            format!("refine {photograph} --predictions 1 --fov 60 --force -o out --prior-model {arguments}");
        assert_eq!(place.run(&refine).contains(exchanged), code == 1, "{arguments}");
    }
}
