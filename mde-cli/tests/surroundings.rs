//! Names that are no Unicode, a system without threads, a signal within a prediction.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used)]

mod common;

use assert_cmd::Command;
use common::{Place, names};
use mde_cli::mde_prior::format::write_png16;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::{OsStrExt, OsStringExt};

/// `text` with every `?` as a byte that is no UTF-8.
fn odd(text: &str) -> OsString {
    OsString::from_vec(text.bytes().map(|byte| if byte == b'?' { 0xff } else { byte }).collect())
}

fn mde(place: &Place, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mde"));
    command.current_dir(place.path(".")).args(arguments.split_whitespace().map(odd));
    command
}

#[test]
fn paths_need_not_be_unicode() {
    let place = Place::new();
    let folder = place.path(".");
    let put = |from: &str, to: &str| fs::copy(place.path(from), folder.join(odd(to))).unwrap();
    let make = |name: &str| fs::create_dir_all(folder.join(odd(name))).unwrap();
    put("image.png", "ph?.png");
    put("depth.npy", "d?.npy");
    put("tiny.toml", "t?.toml");
    for name in ["maps?", "gt?", "data?/scene", "pr?", "shots?"] {
        make(name);
    }
    put("depth.npy", "maps?/a.npy");
    put("depth.npy", "gt?/a.npy");
    put("depth.npy", "pr?/scene.npy");
    put("image.png", "data?/scene/color.png");
    write_png16(folder.join(odd("data?/scene/depth.png")), place.scene.depth.view(), 1000.0).unwrap();
    put("image.png", "shots?/a?.png");
    put("image.png", "shots?/b.png");
    let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures/");
    fs::copy(format!("{fixtures}grey_nchw.onnx"), folder.join(odd("net?.onnx"))).unwrap();
    #[cfg(feature = "onnx")]
    let net = "--prior-model net?.onnx --model-profile fastdepth --fov 60";
    let camera = r#"{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}"#;
    fs::write(folder.join(odd("data?/scene/scene.json")), camera).unwrap();
    let eval = "data? --dataset plain --prior-depth pr? -q";
    for arguments in [
        "refine ph?.png --prior-depth d?.npy --gt d?.npy --fov 60 --config t?.toml --save-field --export ply,colmap -o out?",
        "refine ph?.png --prior-depth d?.npy --fov 60 --config t?.toml --log-json -o json?",
        "refine ph?.png --prior-depth d?.npy --fov 60 --no-nerf -o q?/deep?",
        "warp ph?.png --prior-depth d?.npy --fov 60 --config t?.toml --log-json -o views?",
        "render --field out?/field.safetensors --size 32x24 --fov 60 --log-json -o render?",
        "report out?",
        #[cfg(feature = "onnx")]
        &format!("refine ph?.png {net} -o net?"),
        #[cfg(feature = "onnx")]
        &format!("refine shots? {net} --log-json -o many?"),
        #[cfg(feature = "onnx")]
        &format!("refine ph?.png --views shots? {net} --config t?.toml --log-json -o views-of?"),
        "eval --pred maps? --gt gt? -q -o scores?",
        &format!("eval {eval} --methods guided -o e?"),
        &format!("ablate {eval} --config t?.toml --rows mean --seeds 1 -o a?"),
        &format!("calibrate {eval} --method t?.toml -o c?"),
        "demo --preset fast --size 32x24 --config t?.toml -q -o demo?",
    ] {
        // An option's value that is text, and not a path, may still be refused with the usage.
        let output = mde(&place, arguments).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        let usage = arguments.contains("--method t?");
        let expected = if usage { Some(2) } else { Some(0) };
        assert_eq!(output.status.code(), expected, "{arguments}: {told}");
    }
    let left = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(!left.into_iter().any(|name: OsString| name.as_bytes().starts_with(b".mde-")));
    assert!(folder.join(OsStr::from_bytes(b"out\xff")).join("report.html").is_file());
}

/// No thread starts whose stack is larger than the memory.
#[test]
fn a_system_without_threads_takes_one() {
    let place = Place::new();
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml -q";
    place.mde(&format!("{refine} -o usual")).assert().success();
    let alone = |arguments: &str| {
        place.mde(arguments).env("RUST_MIN_STACK", (1_u64 << 46).to_string()).assert().success();
    };
    alone(&format!("{refine} -o alone"));
    for name in ["depth.npy", "sigma.npy"] {
        let read = |folder: &str| fs::read(place.path(folder).join(name)).unwrap();
        assert!(read("usual") == read("alone"), "{name}");
    }
    alone("eval --dataset rooms --size 64x48 --limit 2 --jobs 2 --methods guided -q -o e");
    assert_eq!(names(&place.path("e/scenes")).len(), 2);
}

/// The network repeats a convolution for minutes.
#[cfg(feature = "onnx")]
#[test]
fn a_prediction_can_be_interrupted() {
    use std::io::{BufRead, BufReader};
    use std::time::{Duration, Instant};
    let place = Place::new();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures/slow.onnx");
    place.write("slow.toml", "width = 1024\nheight = 1024\noutput = 'metric'\n");
    fs::copy(model, place.path("slow.onnx")).unwrap();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
        .current_dir(place.path("."))
        .args("refine image.png --prior-model slow.onnx --fov 60 --log-json -o out".split_whitespace())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains("\"prior\"")), "the prediction does not begin");
    std::thread::sleep(Duration::from_millis(200));
    assert!(child.try_wait().unwrap().is_none(), "the network is not slow");
    let begin = Instant::now();
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(begin.elapsed() < Duration::from_secs(60), "{:?}", begin.elapsed());
    assert!(!names(&place.path(".")).iter().any(|name| name.starts_with(".mde-") || name == "out"));
}
