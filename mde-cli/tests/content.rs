//! Kept results belong to the content of the inputs, not to their names, and are checked before they are used again.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, TINY, WIDTH, names, wait_until};
use mde_cli::mde_prior::format::{write_npy, write_png16};
use mde_eval::data::{DataSet, Rooms};
use std::fs;
use std::process::Stdio;

const EVAL: &str = "eval --dataset rooms --size 64x48 --limit 1";

/// A folder `pr` with a wrong prior of the first room, and the room's identifier and true depth.
fn room(place: &Place) -> (String, ndarray::Array2<f32>) {
    let rooms = Rooms::new(0, WIDTH, HEIGHT);
    let sample = rooms.load(0).unwrap();
    let wrong = ndarray::Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| 1.0 + (x * y) as f32 * 1e-3);
    let file = place.path(&format!("pr/{}.npy", sample.id));
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    write_npy(file, wrong.view()).unwrap();
    (sample.id, sample.depth)
}

fn stderr(place: &Place, arguments: &str) -> String {
    let run = place.mde(arguments).assert().success();
    String::from_utf8(run.get_output().stderr.clone()).unwrap()
}

#[test]
fn a_prior_is_known_by_its_content_and_not_by_its_folder() {
    let place = Place::new();
    let (id, truth) = room(&place);
    let eval = |rest: &str| format!("{EVAL} --methods prior {rest}");
    let score = |out: &str| -> f64 {
        let text = fs::read_to_string(place.path(out).join("scenes.csv")).unwrap();
        let mut rows = text.lines().map(|line| line.split(','));
        let column = rows.next().unwrap().position(|name| name == "abs_rel").unwrap();
        let value: f64 = rows.next().unwrap().nth(column).unwrap().parse().unwrap();
        // Kept scores may differ in their last digit.
        (value * 1e9).round()
    };
    stderr(&place, &eval("--prior-depth pr -o e"));
    let wrong = score("e");
    // The same files by another path, and elsewhere.
    fs::create_dir(place.path("x")).unwrap();
    assert!(!stderr(&place, &eval("--prior-depth x/../pr -o e")).contains("computed again"));
    fs::rename(place.path("pr"), place.path("moved")).unwrap();
    assert!(!stderr(&place, &eval("--prior-depth moved -o e")).contains("computed again"));
    assert_eq!(score("e"), wrong);
    // Other files of the same names.
    write_npy(place.path(&format!("moved/{id}.npy")), truth.view()).unwrap();
    assert!(stderr(&place, &eval("--prior-depth moved -o e")).contains("computed again"));
    stderr(&place, &eval("--prior-depth moved -o fresh"));
    assert!(wrong > 1e8 && score("e") == 0.0 && score("fresh") == 0.0);
    // The same files, read otherwise.
    assert!(stderr(&place, &eval("--prior-depth moved --png-scale 2 -o e")).contains("computed again"));
}

#[cfg(feature = "onnx")]
#[test]
fn weights_beside_the_model_count_as_the_model() {
    let place = Place::new();
    let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures");
    for name in ["external.onnx", "external.bin"] {
        fs::copy(format!("{fixtures}/{name}"), place.path(name)).unwrap();
    }
    place.write("external.toml", "width = 32\nheight = 32\noutput = 'metric'\n");
    let eval = format!("{EVAL} --methods prior --prior-model external.onnx -o e");
    stderr(&place, &eval);
    assert!(!stderr(&place, &eval).contains("computed again"));
    let weights: Vec<u8> = [0.9_f32, 0.05, 0.05].iter().flat_map(|w| w.to_le_bytes()).collect();
    place.write("external.bin", weights);
    assert!(stderr(&place, &eval).contains("computed again"));
}

#[cfg(feature = "onnx")]
#[test]
fn weights_beside_the_model_count_for_every_command_that_continues() {
    let place = Place::new();
    let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../mde-prior/tests/fixtures");
    fs::copy(format!("{fixtures}/external.onnx"), place.path("external.onnx")).unwrap();
    place.write("external.toml", "width = 32\nheight = 32\noutput = 'metric'\n");
    place.write(
        "short.toml",
        TINY.replace("steps = 60", "steps = 10").replace("iterations = 2", "iterations = 1"),
    );
    let usual = fs::read(format!("{fixtures}/external.bin")).unwrap();
    let other: Vec<u8> = [0.9_f32, 0.05, 0.05].iter().flat_map(|w| w.to_le_bytes()).collect();

    let rooms = "--dataset rooms --size 64x48 --prior-model external.onnx";
    for command in [
        format!("ablate {rooms} --limit 1 --rows mean --seeds 1 --config short.toml -o a"),
        format!("calibrate {rooms} --limit 3 --method short.toml -o c"),
    ] {
        place.write("external.bin", &usual);
        stderr(&place, &command);
        assert!(!stderr(&place, &command).contains("computed again"), "{command}");
        place.write("external.bin", &other);
        assert!(stderr(&place, &command).contains("computed again"), "{command}");
    }
}

#[test]
fn a_damaged_map_is_computed_again() {
    let place = Place::new();
    let eval = format!("{EVAL} --methods guided -o e");
    stderr(&place, &eval);
    let scene = fs::read_dir(place.path("e/scenes")).unwrap().next().unwrap().unwrap().path();
    let map = scene.join("guided/depth.npy");
    let whole = fs::read(&map).unwrap();
    let mut altered = whole.clone();
    *altered.last_mut().unwrap() ^= 1;
    for broken in [altered, whole[..whole.len() / 2].to_vec(), Vec::new()] {
        fs::write(&map, broken).unwrap();
        assert!(stderr(&place, &eval).contains("guided: computed again"));
        assert_eq!(fs::read(&map).unwrap(), whole);
    }
    fs::remove_file(&map).unwrap();
    assert!(stderr(&place, &eval).contains("guided: computed again"));
    assert!(!stderr(&place, &eval).contains("computed again"));
}

#[test]
fn one_evaluation_at_a_time_writes_a_folder() {
    let place = Place::new();
    place.write("long.toml", TINY.replace("steps = 60", "steps = 100000"));
    let mut first = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
        .current_dir(place.path("."))
        .args(format!("{EVAL} --methods long.toml -o e").split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until(&mut first, || place.path("e/eval.json").is_file());
    let second = format!("{EVAL} --methods guided -q -o e");
    let refused = place.mde(&second).assert().code(1);
    let told = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(told.contains(&format!("another process ({})", first.id())) && told.contains("-o"), "{told}");
    // The lock of a killed process holds nobody.
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(place.path("e/.mde-lock").exists());
    place.mde(&second).assert().success();
    assert!(!names(&place.path("e")).iter().any(|name| name.starts_with('.')));
}

#[test]
fn scenes_may_have_long_names() {
    let place = Place::new();
    let name = "室".repeat(60);
    for folder in ["maps", "truth"] {
        fs::create_dir(place.path(folder)).unwrap();
        fs::copy(place.path("depth.npy"), place.path(&format!("{folder}/{name}.npy"))).unwrap();
    }
    place.mde("eval --pred maps --gt truth -q -o maps-scored").assert().success();
    let scene = place.path(&format!("data/{name}"));
    fs::create_dir_all(&scene).unwrap();
    fs::copy(place.path("image.png"), scene.join("color.png")).unwrap();
    write_png16(scene.join("depth.png"), place.scene.depth.view(), 1000.0).unwrap();
    fs::write(scene.join("scene.json"), r#"{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}"#).unwrap();
    fs::create_dir(place.path("pr")).unwrap();
    fs::copy(place.path("depth.npy"), place.path(&format!("pr/{name}.npy"))).unwrap();
    place.mde("eval data --dataset plain --prior-depth pr --methods guided -q -o e").assert().success();
    assert_eq!(names(&place.path("e/scenes")).len(), 1);
}
