//! The reports, and the program's own help: completions, manual pages, the doctor.

use crate::common::{HEIGHT, Place, WIDTH, fixture, names, shared};
use serde_json::{Value, json};
use std::fs;

/// What the page holds. It loads nothing: the only address in it is the name of the SVG namespace.
fn data(html: &str) -> Value {
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
fn an_evaluation_has_a_report_with_thumbnails() {
    let place = Place::new();
    let eval = "eval --dataset rooms --size 64x48 --limit 2 --methods tiny.toml,guided -o e";
    let [said, _] = place.told(eval, 0);
    assert!(said.contains("report: e/report.html"), "{said}");
    let html = place.text("e/report.html");
    let data = data(&html);
    assert_eq!(data["kind"], "evaluation");
    assert_eq!(data["summary"]["command_line"].as_str().unwrap(), format!("mde {eval}"));
    assert_eq!(data["figures"].as_array().unwrap().len(), 3);
    let scenes = data["scenes"].as_array().unwrap();
    assert_eq!(scenes.len(), 2);
    for scene in scenes {
        assert!(scene["thumbnails"]["image"].as_str().unwrap().starts_with("data:image/png;base64,"));
        let maps = scene["thumbnails"]["maps"].as_array().unwrap();
        let methods: Vec<&str> = maps.iter().map(|map| map["method"].as_str().unwrap()).collect();
        assert_eq!(methods, ["prior", "guided", "tiny"]);
        assert!(!maps[0]["sigma"].is_string() && maps[2]["sigma"].is_string());
        assert!(scene["scores"]["tiny"]["abs_rel"].as_f64().unwrap() > 0.0);
    }
    fs::remove_file(place.path("e/report.html")).unwrap();
    place.run("report e");
    assert!(place.text("e/report.html") == html);
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let place = Place::new();
    let commands = ["demo", "refine", "warp", "render", "eval", "ablate", "config", "report", "doctor"];
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let [text, _] = place.told(&format!("completions {shell}"), 0);
        assert!(commands.iter().all(|name| text.contains(name)) && text.contains("prior-model"), "{shell}");
    }
    let [main, _] = place.told("man", 0);
    assert!(main.starts_with(".ie") && main.contains(".TH"), "{main}");
    assert!(commands.iter().all(|name| main.contains(name)));
    assert!(place.told("man refine", 0)[0].contains("\\-\\-prior\\-model"));
    place.refused("man polish", &["polish", "refine"]);
}

#[test]
fn the_doctor_knows_the_machine() {
    let place = Place::new();
    let [said, told] = place.told("doctor", 0);
    let version = format!("mde-cli {}", env!("CARGO_PKG_VERSION"));
    assert!(
        told.is_empty() && ["threads", "memory", &version].iter().all(|word| said.contains(word)),
        "{said}"
    );
    place.write("net.onnx", "this is no model");
    let [_, told] = place.told("doctor --prior-model net.onnx", 1);
    assert!(told.contains("net.onnx"), "{told}");
}

/// The doctor's lines about a model, and its error where there is one.
#[cfg(feature = "onnx")]
fn doctor(place: &Place, model: &str, code: i32) -> (Vec<(String, String)>, String) {
    let [text, error] = place.told(&format!("doctor --prior-model {model}"), code);
    let lines = text.lines().map(|line| line.split_once(' ').unwrap());
    (lines.map(|(what, said)| (what.to_owned(), said.trim().to_owned())).collect(), error)
}

/// One of the doctor's lines.
#[cfg(feature = "onnx")]
fn said<'a>(lines: &'a [(String, String)], what: &str) -> Option<&'a str> {
    lines.iter().find(|(name, _)| name == what).map(|(_, said)| said.as_str())
}

/// The mean of the correlations in the doctor's trial.
#[cfg(feature = "onnx")]
fn correlation(lines: &[(String, String)]) -> f64 {
    let each = said(lines, "trial").unwrap().rsplit(": ").next().unwrap();
    let each: Vec<f64> = each.split(", ").map(|number| number.trim().parse().unwrap()).collect();
    assert!(each.len() > 4, "{each:?}");
    each.iter().sum::<f64>() / each.len() as f64
}

#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn the_doctor_tries_a_model() {
    let place = Place::new();
    let path = |name: &str| shared().join(name).display().to_string();
    let model = path("models/fastdepth/fastdepth_224.onnx");
    let (lines, error) = doctor(&place, &model, 0);
    assert!(error.is_empty(), "{error}");
    assert_eq!(said(&lines, "models"), Some("ONNX files"));
    assert!(said(&lines, "model").unwrap().contains("fastdepth_224.onnx"));
    let profile: Value = serde_json::from_str(said(&lines, "profile").unwrap()).unwrap();
    assert_eq!((profile["width"].as_u64(), profile["output"].as_str()), (Some(224), Some("metric")));
    let runtime = said(&lines, "runtime").unwrap();
    assert!(runtime.starts_with("tract: ") && runtime.contains("default needs 30 predictions"), "{runtime}");
    assert!(correlation(&lines) > 0.5, "{lines:?}");
    assert_eq!(said(&lines, "verdict"), Some("the model works here"));

    let (lines, error) = doctor(&place, &format!("{model} --model-profile midas-v2.1-small"), 1);
    assert!(correlation(&lines) < -0.5 && said(&lines, "verdict").is_none(), "{lines:?}");
    assert!(error.contains("fastdepth_224.onnx") && error.contains("near and far are exchanged"), "{error}");
    // Under another name its layers tell it.
    place.take(&model, "model.onnx");
    assert_eq!(said(&doctor(&place, "model.onnx", 0).0, "verdict"), Some("the model works here"));
    let small = path("models/upydnet_nyu48/model.onnx");
    place.write("small.toml", "width = 48\nheight = 48\noutput = 'metric'\n");
    let kind = |kind: &str| format!("{small} --model-profile small.toml --prior-kind {kind}");
    assert_eq!(said(&doctor(&place, &kind("disparity"), 0).0, "verdict"), Some("the model works here"));
    assert!(doctor(&place, &kind("metric"), 1).1.contains("give --prior-kind disparity"));

    // A refinement warns of the same.
    let photograph = path("data/plain/nyu_00000/color.jpg");
    for (net, told) in [
        (format!("{model} --prior-kind depth"), false),
        (format!("{model} --prior-kind disparity"), true),
        (format!("{model} --model-profile midas-v2.1-small"), true),
        (kind("disparity"), false),
        (kind("depth"), true),
    ] {
        let refine =
            format!("refine {photograph} --predictions 1 --fov 60 --force -o out --prior-model {net}");
        let text = place.run(&refine);
        assert_eq!(text.contains("near and far are exchanged"), told, "{net}: {text}");
    }
}

/// What the error about an unknown network advises, the doctor takes; and it tells a wrong profile and a useless model.
#[test]
#[cfg(feature = "onnx")]
fn the_doctor_tells_a_wrong_profile_and_a_useless_model() {
    let place = Place::new();
    for name in ["grey_nchw.onnx", "grey_nhwc.onnx", "scores.onnx", "not_finite.onnx"] {
        place.take(fixture(name), name);
    }
    place.take("grey_nchw.onnx", "net.onnx");
    assert!(doctor(&place, "net.onnx", 1).1.contains("or a file net.toml beside it"));
    place.write("net.toml", "width = 48\nheight = 32\noutput = 'metric'\n");
    let (lines, error) = doctor(&place, "net.onnx --prior-kind depth", 1);
    let profile = said(&lines, "profile").unwrap();
    assert!(profile.contains("\"width\":48") && profile.contains("\"output\":\"depth\""), "{profile}");
    assert!(error.contains("beyond chance"), "{error}");
    // It takes brightness for depth, which is better than the reverse in most rooms, but not beyond chance.
    for (profile, sign) in [("fastdepth", 1.0), ("midas-v2.1-small", -1.0)] {
        let (lines, error) = doctor(&place, &format!("grey_nchw.onnx --model-profile {profile}"), 1);
        assert!((0.1..0.25).contains(&(sign * correlation(&lines))), "{lines:?}");
        assert!(said(&lines, "verdict").is_none(), "{lines:?}");
        assert!(error.contains("beyond chance") && error.contains("check the profile"), "{error}");
    }
    for (model, profile, told) in [
        ("grey_nchw.onnx", "", "--model-profile (fastdepth"),
        ("grey_nhwc.onnx", "--model-profile fastdepth", "check layout"),
        ("scores.onnx", "--model-profile fastdepth", "output-name"),
        ("not_finite.onnx", "--model-profile fastdepth", "check mean"),
    ] {
        let (lines, error) = doctor(&place, &format!("{model} {profile}"), 1);
        assert!(said(&lines, "memory").is_some() && said(&lines, "verdict").is_none(), "{lines:?}");
        assert!(error.contains(model) && error.contains(told) && error.lines().count() == 1, "{error}");
    }
}
