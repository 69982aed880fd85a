//! What is wrong is said in one line, with the file or value at fault, and nothing is written.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, WIDTH};
use mde_cli::mde_prior::format::write_npy;
use mde_cli::mde_prior::photo::write_image;
use ndarray::{Array2, Array3};
use std::fs;

fn place() -> Place {
    let place = Place::new();
    let map = |value: f32| Array2::from_elem((HEIGHT, WIDTH), value);
    write_npy(place.path("zero.npy"), map(0.0).view()).unwrap();
    write_npy(place.path("small.npy"), Array2::from_elem((HEIGHT / 2, WIDTH / 2), 2.0).view()).unwrap();
    write_image(place.path("dot.png"), Array3::from_elem((1, 1, 3), 0.5).view()).unwrap();
    let mut nan = fs::read(place.path("zero.npy")).unwrap();
    let values = nan.len() - 4 * WIDTH * HEIGHT;
    nan[values..].chunks_exact_mut(4).for_each(|value| value.copy_from_slice(&f32::NAN.to_le_bytes()));
    place.write("nan.npy", &nan);
    place.write("short.npy", &nan[..nan.len() - 99]);
    place.write("empty.png", "");
    place.write("empty.npy", "");
    place.write("text.png", "this is no picture");
    place.write("fastdepth.onnx", "this is no model");
    place.write("mystery.onnx", "this is no model");
    place.write("key.toml", "[nerf.train]\nstep = 3\n");
    place.write("range.toml", "[nerf.train]\nsteps = 0\n");
    place.write("broken.toml", "seed = = 1\n");
    place.write("broken.txt", "520 0 320 0 520");
    place.write("skewed.txt", "520 9 32 0 520 24 0 0 1");
    place
        .write("other.json", "{\"fx\": 9, \"fy\": 9, \"cx\": 1, \"cy\": 1, \"width\": 640, \"height\": 480}");
    place.write("file", "");
    place.write("field.safetensors", "this is no field");
    fs::create_dir(place.path("empty")).unwrap();
    fs::create_dir(place.path("thesis")).unwrap();
    place.write("thesis/chapter.txt", "years");
    place
}

/// Arguments after `mde`, and what the message must contain. `-o out --quiet` is added where there is no `-o`.
const FAILURES: &[(&str, &[&str])] = &[
    ("refine none.png --prior-depth depth.npy", &["none.png", "check the path"]),
    ("refine empty.png --prior-depth depth.npy", &["empty.png", "is empty"]),
    ("refine text.png --prior-depth depth.npy", &["text.png", "give a JPEG"]),
    ("refine . --prior-depth depth.npy", &["give a file, not a folder"]),
    ("refine dot.png --prior-depth depth.npy", &["dot.png", "1x1", "8x8"]),
    ("refine image.png --prior-depth none.npy", &["none.npy", "check the path"]),
    ("refine image.png --prior-depth empty.npy", &["empty.npy", "is empty"]),
    ("refine image.png --prior-depth short.npy", &["short.npy"]),
    ("refine image.png --prior-depth small.npy", &["small.npy", "32x24", "64x48", "resize"]),
    ("refine image.png --prior-depth nan.npy", &["nan.npy", "no usable pixel"]),
    ("refine image.png --prior-depth zero.npy", &["zero.npy", "no usable pixel"]),
    ("refine image.png --prior-depth tiny.toml", &["tiny.toml", ".npy"]),
    ("refine image.png --prior-depth depth.npy --png-scale 0", &["png-scale", "0 is no scale"]),
    ("refine image.png --prior-depth depth.npy --prior-encoding sunrgbd", &["depth.npy", "PNG"]),
    ("refine image.png --prior-depth depth.npy --config none.toml", &["none.toml"]),
    ("refine image.png --prior-depth depth.npy --config key.toml", &["key.toml", "`step`", "`steps`"]),
    ("refine image.png --prior-depth depth.npy --config range.toml", &["range.toml", "train.steps is 0"]),
    ("refine image.png --prior-depth depth.npy --config broken.toml", &["broken.toml"]),
    ("refine image.png --prior-depth depth.npy --fov 0", &["field of view is 0"]),
    ("refine image.png --prior-depth depth.npy --fov 180", &["field of view is 180"]),
    ("refine image.png --prior-depth depth.npy --fx 0", &["fx is 0"]),
    ("refine image.png --prior-depth depth.npy --fx nan", &["fx is NaN"]),
    ("refine image.png --prior-depth depth.npy --fx 50 --fy -50", &["fy is -50"]),
    ("refine image.png --prior-depth depth.npy --intrinsics none.txt", &["none.txt", "check the path"]),
    ("refine image.png --prior-depth depth.npy --intrinsics broken.txt", &["broken.txt", "5 numbers", "3x3"]),
    (
        "refine image.png --prior-depth depth.npy --intrinsics skewed.txt",
        &["skewed.txt", "[fx 0 cx; 0 fy cy; 0 0 1]"],
    ),
    ("refine image.png --prior-depth depth.npy --intrinsics other.json", &["other.json", "640x480", "64x48"]),
    ("refine image.png --prior-depth depth.npy --gt none.npy", &["none.npy", "check the path"]),
    ("refine image.png --prior-depth depth.npy --gt small.npy", &["small.npy", "32x24", "64x48"]),
    ("refine image.png --prior-depth depth.npy --gt zero.npy", &["zero.npy", "no pixel"]),
    ("refine image.png --prior-depth depth.npy -o empty", &["empty", "--force"]),
    ("refine image.png --prior-depth depth.npy -o file --force", &["file", "no folder"]),
    ("refine image.png --prior-depth depth.npy -o file/out", &["file", "no folder"]),
    ("refine image.png --prior-depth depth.npy -o thesis --force", &["thesis", "run.json"]),
    ("refine image.png --prior-depth depth.npy -o ..", &["..", "-o"]),
    ("demo --size 64x48 -o empty", &["empty", "--force"]),
    ("warp image.png --prior-depth small.npy", &["small.npy", "64x48"]),
    ("render --field none.safetensors --size 64x48", &["none.safetensors"]),
    ("render --field field.safetensors --size 64x48", &["field.safetensors", "not a usable field"]),
];

#[cfg(feature = "onnx")]
const MODEL_FAILURES: &[(&str, &[&str])] = &[
    ("refine image.png --prior-model none.onnx", &["none.onnx"]),
    ("refine image.png --prior-model fastdepth.onnx", &["fastdepth.onnx"]),
    ("refine image.png --prior-model mystery.onnx", &["mystery.onnx", "fastdepth", "dpt-large"]),
    ("refine image.png --prior-model fastdepth.onnx --model-profile nonsense", &["nonsense", "dpt-large"]),
];
#[cfg(not(feature = "onnx"))]
const MODEL_FAILURES: &[(&str, &[&str])] =
    &[("refine image.png --prior-model fastdepth.onnx", &["fastdepth.onnx", "--features onnx"])];

/// What clap refuses.
const USAGES: &[(&str, &[&str])] = &[
    ("", &["Usage"]),
    ("polish image.png", &["polish"]),
    ("refine image.png", &["--prior-model", "--prior-depth"]),
    ("refine image.png --prior-depth depth.npy", &["--output"]),
    (
        "refine image.png --prior-depth depth.npy --prior-model fastdepth.onnx -o out",
        &["cannot be used with"],
    ),
    ("refine image.png --prior-depth depth.npy --flip-average -o out", &["cannot be used with"]),
    ("refine image.png --prior-depth depth.npy --fov 60 --fx 500 -o out", &["cannot be used with"]),
    ("refine image.png --prior-depth depth.npy --cx 3 -o out", &["--fx"]),
    ("refine image.png --prior-depth depth.npy --fov 60 --cy 3 -o out", &["cannot be used with"]),
    ("refine image.png --prior-depth depth.npy --fx 60 --intrinsics-base 1 -o out", &["cannot be used with"]),
    ("refine image.png --prior-model fastdepth.onnx --png-scale 3 -o out", &["cannot be used with"]),
    ("refine image.png --prior-depth depth.npy --prior-kind height -o out", &["height", "disparity"]),
    ("refine image.png --prior-depth depth.npy --preset best -o out", &["best", "paper"]),
    ("refine image.png --prior-depth depth.npy --seed -1 -o out", &["--seed"]),
    ("refine image.png --prior-depth depth.npy --threads 0 -o out", &["--threads"]),
    ("refine image.png --prior-depth depth.npy --gt-scale 3 -o out", &["--gt"]),
    ("demo --size 320 -o out", &["WIDTHxHEIGHT"]),
    ("demo --quiet --log-json -o out", &["cannot be used with"]),
    ("render --field f --size 64x48 --orbit 3 --translate 1,2,3 -o out", &["cannot be used with"]),
    ("render --field f --size 64x48 --translate 1,2 -o out", &["three numbers"]),
];

#[test]
fn failures_are_told_in_one_line_and_leave_nothing() {
    let place = place();
    let before = place.entries();
    for (arguments, told) in FAILURES.iter().chain(MODEL_FAILURES) {
        let output = if arguments.contains(" -o ") { "" } else { " -o out" };
        let run = place.mde(&format!("{arguments}{output} --quiet")).output().unwrap();
        let message = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(1), "{arguments}: {message}");
        assert!(
            message.starts_with("error: ") && message.trim_end().lines().count() == 1,
            "{arguments}: {message}"
        );
        for part in *told {
            assert!(message.contains(part), "{arguments}: no {part:?} in {message}");
        }
        assert!(run.stdout.is_empty(), "{arguments}");
        assert_eq!(place.entries(), before, "{arguments}");
    }
    assert_eq!(fs::read_to_string(place.path("thesis/chapter.txt")).unwrap(), "years");
}

#[test]
fn wrong_usage_is_told_with_exit_code_2() {
    let place = place();
    for (arguments, told) in USAGES {
        let run = place.mde(arguments).output().unwrap();
        let message = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(2), "{arguments}: {message}");
        for part in *told {
            assert!(message.contains(part), "{arguments}: no {part:?} in {message}");
        }
    }
    assert!(!place.path("out").exists());
}
