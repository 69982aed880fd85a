//! The report, the files for other programs, and the program's own help.
#![allow(clippy::expect_used, clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, TINY, WIDTH, names};
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_npy};
use mde_cli::mde_prior::photo::write_image;
use mde_eval::scene::{Room, room};
use ndarray::{Array2, Array3};
use ndarray_npy::read_npy;
use predicates::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;

const RUN: &str = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml";

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

/// What the page holds.
fn data(html: &str) -> Value {
    let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..end]).unwrap()
}

/// The page loads nothing: the only address in it is the name of the SVG namespace.
fn check_alone(html: &str) {
    assert!(html.contains("default-src 'none'"));
    let named = html.matches("http://www.w3.org/2000/svg").count();
    assert_eq!(html.matches("://").count(), named);
    assert_eq!(html.matches("<script").count(), 2);
    assert!(!html.contains("<link") && !html.contains("@import") && !html.contains("{{"));
}

#[test]
fn a_run_has_a_report_that_can_be_made_again() {
    let place = Place::new();
    place.write("a 'b.png", fs::read(place.path("image.png")).unwrap());
    let mut command =
        place.mde("refine --prior-depth depth.npy --fov 60 --config tiny.toml --gt depth.npy -o out");
    command.arg("a 'b.png").assert().success().stdout(predicate::str::contains("open out/report.html"));
    let path = place.path("out/report.html");
    let html = read(&path);
    check_alone(&html);
    let data = data(&html);
    assert_eq!((data["kind"].as_str(), data["title"].as_str()), (Some("run"), Some("a 'b.png")));
    assert_eq!(data["size"], serde_json::json!([WIDTH, HEIGHT]));
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

    fs::remove_file(&path).unwrap();
    let before = names(&place.path("out"));
    place.mde("report out").assert().success().stdout(predicate::str::contains("out/report.html"));
    assert!(read(&path) == html);
    assert_eq!(names(&place.path("out")).len(), before.len() + 1);
}

#[test]
fn an_evaluation_has_a_report_with_thumbnails() {
    let place = Place::new();
    let eval = "eval --dataset rooms --size 64x48 --limit 2 --methods tiny.toml,guided -o e";
    place.mde(eval).assert().success().stdout(predicate::str::contains("report: e/report.html"));
    let html = read(&place.path("e/report.html"));
    check_alone(&html);
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
        let sigma = |index: usize| maps[index]["sigma"].is_string();
        assert!(!sigma(0) && sigma(2));
        assert!(scene["scores"]["tiny"]["abs_rel"].as_f64().unwrap() > 0.0);
    }
    fs::remove_file(place.path("e/report.html")).unwrap();
    place.mde("report e").assert().success();
    assert!(read(&place.path("e/report.html")) == html);
}

#[test]
fn a_folder_without_a_report_is_told_in_one_line() {
    let place = Place::new();
    place.mde(&format!("{RUN} -q -o out")).assert().success();
    place.mde("warp image.png --prior-depth depth.npy --fov 60 -q -o views").assert().success();
    fs::remove_file(place.path("out/image.png")).unwrap();
    for (folder, named) in [
        ("none", &["none", "run.json", "summary.json"][..]),
        ("views", &["views", "mde warp", "mde refine"]),
        ("out", &["image.png", "run the refinement again"]),
    ] {
        let run = place.mde(&format!("report {folder}")).assert().code(1).stdout("");
        let text = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(named.iter().all(|word| text.contains(word)), "{text}");
    }
}

#[test]
fn files_for_other_programs_are_written_where_asked_for() {
    let place = Place::new();
    place.mde(&format!("{RUN} -q -o plain")).assert().success();
    place.mde(&format!("{RUN} -q --export ply,exr,colmap,glb,transforms -o out")).assert().success();
    let mut expected = [
        names(&place.path("plain")),
        ["cloud.ply", "colmap", "depth.exr", "mesh.glb", "transforms.json"].map(str::to_owned).to_vec(),
    ]
    .concat();
    expected.sort();
    assert_eq!(names(&place.path("out")), expected);
    assert_eq!(names(&place.path("out/colmap/sparse/0")), ["cameras.txt", "images.txt", "points3D.txt"]);
    assert_eq!(names(&place.path("out/colmap/images")), ["image.png"]);
    for (channel, file) in
        [("Y", "depth.npy"), ("Z", "depth.npy"), ("sigma", "sigma.npy"), ("prior", "prior.npy")]
    {
        let options = ReadOptions { exr_channel: Some(channel.to_owned()), ..ReadOptions::default() };
        let map: Array2<f32> = read_npy(place.path("out").join(file)).unwrap();
        assert_eq!(read_values(place.path("out/depth.exr"), &options).unwrap(), map, "{channel}");
    }
    let depth: Array2<f32> = read_npy(place.path("out/depth.npy")).unwrap();
    let known = depth.iter().filter(|d| **d > 0.0).count();
    let cloud = fs::read(place.path("out/cloud.ply")).unwrap();
    let header = String::from_utf8_lossy(&cloud[..600]);
    assert!(header.contains(&format!("element vertex {known}\n")) && header.contains("property float sigma"));
    place.mde(&format!("{RUN} --export obj -o x")).assert().code(2).stderr(predicate::str::contains("ply"));
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let place = Place::new();
    let commands = ["demo", "refine", "warp", "render", "eval", "ablate", "config", "report", "doctor"];
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let run = place.mde(&format!("completions {shell}")).assert().success();
        let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
        assert!(commands.iter().all(|name| text.contains(name)) && text.contains("prior-model"), "{shell}");
    }
    let page = |what: &str| {
        let run = place.mde(&format!("man {what}")).assert().success();
        String::from_utf8(run.get_output().stdout.clone()).unwrap()
    };
    let main = page("");
    assert!(main.starts_with(".ie") && main.contains(".TH"), "{main}");
    assert!(commands.iter().all(|name| main.contains(name)));
    assert!(page("refine").contains("\\-\\-prior\\-model"));
    place
        .mde("man polish")
        .assert()
        .code(1)
        .stderr(predicate::str::contains("polish").and(predicate::str::contains("refine")));
}

#[test]
fn the_doctor_knows_the_machine() {
    let place = Place::new();
    let run = place.mde("doctor").assert().success().stderr("");
    run.stdout(
        predicate::str::contains("threads")
            .and(predicate::str::contains(format!("mde-cli {}", env!("CARGO_PKG_VERSION"))))
            .and(predicate::str::contains("memory")),
    );
    place.write("net.onnx", "this is no model");
    let run = place.mde("doctor --prior-model net.onnx").assert().code(1);
    run.stderr(predicate::str::contains("net.onnx"));
}

/// The doctor's lines about a model, and its error where there is one.
#[cfg(feature = "onnx")]
fn doctor(model: &Path, profile: Option<&str>, code: i32) -> (Vec<(String, String)>, String) {
    let place = Place::new();
    let mut command = place.mde("doctor --prior-model");
    command.arg(model).args(profile.iter().flat_map(|name| ["--model-profile", name]));
    let run = command.assert().code(code);
    let output = run.get_output();
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    let lines = text.lines().map(|line| line.split_once(' ').unwrap());
    let lines = lines.map(|(what, said)| (what.to_owned(), said.trim().to_owned())).collect();
    (lines, String::from_utf8(output.stderr.clone()).unwrap())
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
    let shared = common::shared();
    let model = shared.join("models/fastdepth/fastdepth_224.onnx");
    let (lines, error) = doctor(&model, None, 0);
    assert!(error.is_empty(), "{error}");
    assert_eq!(said(&lines, "models"), Some("ONNX files"));
    assert!(said(&lines, "model").unwrap().contains("fastdepth_224.onnx"));
    let profile: Value = serde_json::from_str(said(&lines, "profile").unwrap()).unwrap();
    assert_eq!((profile["width"].as_u64(), profile["output"].as_str()), (Some(224), Some("metric")));
    let runtime = said(&lines, "runtime").unwrap();
    assert!(runtime.starts_with("tract: ") && runtime.contains("default needs 30 predictions"), "{runtime}");
    assert!(
        correlation(&lines) > 0.5 && said(&lines, "verdict") == Some("the model works here"),
        "{lines:?}"
    );

    let (lines, error) = doctor(&model, Some("midas-v2.1-small"), 1);
    assert!(correlation(&lines) < -0.5 && said(&lines, "verdict").is_none(), "{lines:?}");
    assert!(error.contains("fastdepth_224.onnx") && error.contains("near and far are exchanged"), "{error}");
    // Under another name its layers tell it.
    let place = Place::new();
    fs::copy(&model, place.path("model.onnx")).unwrap();
    let run = place.mde("doctor --prior-model model.onnx").assert().success();
    run.stdout(predicate::str::contains("the model works here"));

    let small = shared.join("models/upydnet_nyu48/model.onnx");
    let run = |kind: &str| {
        let mut command = place.mde(&format!("doctor --input-size 48x48 --prior-kind {kind} --prior-model"));
        command.arg(&small).assert()
    };
    run("disparity").success().stdout(predicate::str::contains("the model works here"));
    run("metric").code(1).stderr(predicate::str::contains("give --prior-kind disparity"));

    // A refinement warns of the same.
    let photograph = shared.join("data/plain/nyu_00000/color.jpg");
    for (net, said, told) in [
        (&model, "--prior-kind depth", false),
        (&model, "--prior-kind disparity", true),
        (&model, "--model-profile midas-v2.1-small", true),
        (&small, "--input-size 48x48 --prior-kind disparity", false),
        (&small, "--input-size 48x48 --prior-kind depth", true),
    ] {
        let mut command = place.mde(&format!("refine --predictions 1 --fov 60 --force -o out {said}"));
        let run = command.arg("--prior-model").arg(net).arg(&photograph).assert().success();
        let text = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        assert_eq!(text.contains("near and far are exchanged"), told, "{said}: {text}");
    }
}

/// What the error about an unknown network advises, the doctor takes.
#[test]
#[cfg(feature = "onnx")]
fn the_doctor_takes_a_size_and_a_kind() {
    let place = Place::new();
    let net = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures/grey_nchw.onnx");
    fs::copy(net, place.path("net.onnx")).unwrap();
    let run = place.mde("doctor --prior-model net.onnx").assert().code(1);
    run.stderr(predicate::str::contains("--input-size WxH with --prior-kind"));
    let run =
        place.mde("doctor --prior-model net.onnx --input-size 48x32 --prior-kind depth").assert().code(1);
    // It takes brightness for depth.
    let told = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(told.contains("\"width\":48") && told.contains("\"output\":\"depth\""), "{told}");
    run.stderr(predicate::str::contains("beyond chance"));
}

#[test]
#[cfg(feature = "onnx")]
fn the_doctor_tells_a_wrong_profile_and_a_useless_model() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    // It takes brightness for depth, which is better than the reverse in most rooms, but not beyond chance.
    let grey = fixtures.join("grey_nchw.onnx");
    for (profile, sign) in [("fastdepth", 1.0), ("midas-v2.1-small", -1.0)] {
        let (lines, error) = doctor(&grey, Some(profile), 1);
        assert!((0.1..0.25).contains(&(sign * correlation(&lines))), "{lines:?}");
        assert!(said(&lines, "verdict").is_none(), "{lines:?}");
        assert!(error.contains("beyond chance") && error.contains("check the profile"), "{error}");
    }
    for (model, profile, told) in [
        ("grey_nchw.onnx", None, "--model-profile (fastdepth"),
        ("grey_nhwc.onnx", Some("fastdepth"), "check layout"),
        ("scores.onnx", Some("fastdepth"), "output-name"),
        ("not_finite.onnx", Some("fastdepth"), "check mean"),
    ] {
        let (lines, error) = doctor(&fixtures.join(model), profile, 1);
        assert!(said(&lines, "memory").is_some() && said(&lines, "verdict").is_none(), "{lines:?}");
        assert!(error.contains(model) && error.contains(told) && error.lines().count() == 1, "{error}");
    }
}

#[test]
fn a_pipe_gets_no_escape_codes_and_the_end_says_what_was_gained() {
    let place = Place::new();
    let run =
        place.mde(&format!("{RUN} -o out")).env("NO_COLOR", "1").env("COLUMNS", "40").assert().success();
    let output = run.get_output();
    assert!(!output.stdout.contains(&0x1b) && !output.stderr.contains(&0x1b));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    for said in [
        "depth: typical change",
        "sigma: median",
        "fusion: a ",
        "weight of the field",
        "wrote out",
        "report.html",
    ] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let kept =
        place.mde("refine image.png --prior-depth depth.npy --fov 60 --no-nerf -o kept").assert().success();
    kept.stdout(predicate::str::contains("depth: as it came: no field was fitted"));
    let help = place.mde("refine --help").env("NO_COLOR", "1").assert().success();
    assert!(!help.get_output().stdout.contains(&0x1b));
}

/// What a terminal of 80 columns gets.
#[cfg(target_os = "linux")]
fn on_a_terminal(place: &Place, arguments: &str, no_color: Option<&str>) -> String {
    let mde = env!("CARGO_BIN_EXE_mde");
    let mut command = std::process::Command::new("script");
    command.args(["-qec", &format!("stty cols 80 rows 24; {mde} {arguments}"), "/dev/null"]);
    command.current_dir(place.path(".")).stdin(std::process::Stdio::null());
    command.env("TERM", "xterm").env_remove("CLICOLOR").env_remove("NO_COLOR");
    no_color.map(|value| command.env("NO_COLOR", value));
    let output = command.output().expect("the program script of util-linux makes a terminal; install it");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn a_terminal_gets_a_coloured_bar_for_each_stage_and_warnings_at_the_end() {
    let place = Place::new();
    let run = "refine image.png --prior-depth depth.npy --config tiny.toml";
    let text = on_a_terminal(&place, &format!("{run} -o a"), None);
    assert!(text.contains("\x1b[36m"), "no colour: {text}");
    for stage in ["prior [", "1/2: warp [", "1/2: fit ", "2/2: render ", "2/2: fuse ["] {
        assert!(text.contains(stage), "no {stage}: {text}");
    }
    let plain = on_a_terminal(&place, &format!("{run} -o b"), Some("1"));
    assert!(!plain.contains("\x1b[3") && plain.contains("1/2: fit "), "{plain}");
    // Once, between the last stage and the results.
    let at = |part: &str| plain.rfind(part).unwrap_or_else(|| panic!("no {part}: {plain}"));
    assert_eq!(plain.matches("the camera is unknown").count(), 1, "{plain}");
    assert!(at("2/2: fuse") < at("warning: the camera is unknown") && at("warning:") < at("depth: typical"));
    // What has no control sequences is no bar, and fits.
    let lines: Vec<&str> = plain.lines().filter(|line| !line.contains('\x1b')).collect();
    assert!(lines.len() > 5 && lines.iter().all(|line| line.trim_end().chars().count() <= 80), "{plain}");
}

#[test]
#[cfg(target_os = "linux")]
fn an_error_is_printed_without_the_warnings_of_its_run() {
    let place = Place::new();
    let run = "refine image.png --prior-depth depth.npy --config tiny.toml --gt nowhere.npy -o out";
    let told = place.mde(run).assert().code(1);
    let message = String::from_utf8(told.get_output().stderr.clone()).unwrap();
    assert!(message.starts_with("error: nowhere.npy") && message.lines().count() == 1, "{message}");
    let text = on_a_terminal(&place, run, None);
    assert!(text.contains("\x1b[31m") && text.contains("error:") && !text.contains("warning"), "{text}");
}

/// The lines that stay on a terminal of 80 columns: of a bar that is drawn again, the last state, which fills its line.
#[cfg(target_os = "linux")]
fn lines(text: &str) -> Vec<String> {
    let last = |line: &str| {
        let line = line.trim_end_matches('\r');
        let shown: Vec<char> =
            console::strip_ansi_codes(&line[line.rfind('\r').map_or(0, |at| at + 1)..]).chars().collect();
        let rows: Vec<String> = shown.chunks(80).map(|row| row.iter().collect()).collect();
        if rows.is_empty() { vec![String::new()] } else { rows }
    };
    text.trim_end().split('\n').flat_map(last).collect()
}

#[test]
#[cfg(target_os = "linux")]
fn an_evaluation_on_a_terminal_ends_with_its_verdict_and_one_line() {
    let place = Place::new();
    let eval = |methods: &str, out: &str| {
        let arguments = format!("eval --dataset rooms --size 64x48 --limit 6 --methods {methods} -o {out}");
        lines(&on_a_terminal(&place, &arguments, None))
    };
    let one = eval("guided", "one");
    assert!(one.len() <= 10, "{one:#?}");
    assert!(one[0].contains("12/12") && one[1].starts_with("- guided: AbsRel "), "{one:#?}");
    assert!(
        one.last().unwrap().ends_with("6 scenes; report: one/report.html; tables: one/table.md"),
        "{one:#?}"
    );
    // The simulated prior accepts no crops: that method fails in each scene.
    let more = eval("guided,jbf,unsharp1,zoom", "more");
    assert!(more.len() <= 24 && more[1].starts_with("- "), "{more:#?}");
    let failures = more.iter().filter(|line| line.contains("failed")).collect::<Vec<_>>();
    assert!(failures.len() == 2 && failures[0].starts_with("- failed: zoom on 6 scenes: "), "{more:#?}");
    assert!(failures[1].starts_with("error: 6 of the runs failed"), "{more:#?}");
}

/// With noise, which no compression makes small.
#[test]
fn the_report_of_a_large_photograph_is_below_five_megabytes() {
    let place = Place::new();
    let scene = room(Room::Study, 0, 160, 120).unwrap();
    let mut state = 1_u32;
    let image = Array3::from_shape_fn((480, 640, 3), |(y, x, c)| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        scene.image[(y / 4, x / 4, c)] + 0.02 * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
    });
    let depth =
        Array2::from_shape_fn((480, 640), |(y, x)| scene.depth[(y / 4, x / 4)] + 1e-4 * (x + 2 * y) as f32);
    write_image(place.path("large.png"), image.view()).unwrap();
    write_npy(place.path("large.npy"), depth.view()).unwrap();
    place.write("quick.toml", TINY.replace("steps = 60", "steps = 5").replace("= 8\n", "= 2\n"));
    let run =
        "refine large.png --prior-depth large.npy --gt large.npy --fov 60 --config quick.toml -q -o out";
    place.mde(run).assert().success();
    let bytes = fs::metadata(place.path("out/report.html")).unwrap().len();
    assert!((1_000_000..5_000_000).contains(&bytes), "{bytes}");
}
