//! What `mde eval` scores is what `mde refine` writes, byte for byte.
#![cfg(feature = "onnx")]
#![allow(clippy::unwrap_used)]

use mde_cli::mde_prior::format::{write_npy, write_png16};
use mde_cli::mde_prior::photo::write_image;
use mde_eval::data::{DataSetKind, Options, Sample, open};
use serde_json::json;
use std::fs;
use std::path::Path;

const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth -q";

/// A small capture of a room: its reference and the further photographs.
fn capture() -> Sample {
    let options = Options { size: Some([64, 48]), ..Options::default() };
    open(DataSetKind::Captures, None, &options).unwrap().load(0).unwrap()
}

/// A folder with `grey.onnx`, whose depth is the brightness, in which the program runs.
fn place() -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    fs::copy(fixtures.join("grey_nchw.onnx"), place.path().join("grey.onnx")).unwrap();
    fs::create_dir_all(place.path().join("data/room")).unwrap();
    place
}

fn mde(place: &Path, arguments: &str) {
    let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_mde"));
    command.current_dir(place).args(arguments.split_whitespace()).assert().success();
}

/// Compares the maps of a method in `scored` with those in `refined`.
fn assert_same(place: &Path, scored: &str, refined: &str) {
    for map in ["depth.npy", "sigma.npy"] {
        let bytes = |folder: &str| fs::read(place.join(folder).join(map)).unwrap();
        assert!(bytes(scored) == bytes(refined), "{scored} {map}");
    }
}

#[test]
fn one_photograph() {
    let (place, sample) = (place(), capture());
    let (place, room) = (place.path(), place.path().join("data/room"));
    write_image(room.join("color.png"), sample.image.view()).unwrap();
    write_npy(room.join("depth.npy"), sample.depth.view()).unwrap();
    let camera = sample.camera;
    let about = json!({ "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy });
    fs::write(room.join("scene.json"), about.to_string()).unwrap();
    fs::write(place.join("intrinsics.json"), about.to_string()).unwrap();
    mde(place, &format!("eval data --methods default,fast {MODEL} -o scored"));
    for preset in ["default", "fast"] {
        let refine =
            format!("refine data/room/color.png --intrinsics intrinsics.json --preset {preset} {MODEL}");
        mde(place, &format!("{refine} -o {preset}"));
        assert_same(place, &format!("scored/scenes/room/{preset}"), preset);
    }
}

#[test]
fn several_photographs_with_poses() {
    let (place, sample) = (place(), capture());
    let (place, room) = (place.path(), place.path().join("data/room"));
    let mut frames = Vec::new();
    let further = sample.views.iter().map(|captured| (&captured.view.image, captured.view.pose));
    for (index, (image, pose)) in
        std::iter::once((&sample.image, mde_warp::Pose::identity())).chain(further).enumerate()
    {
        let name = format!("{index}.png");
        write_image(room.join(&name), image.view()).unwrap();
        // Camera to world, with OpenGL's axes.
        let matrix = pose.inverse().to_homogeneous();
        let row = |y: usize| [matrix[(y, 0)], -matrix[(y, 1)], -matrix[(y, 2)], matrix[(y, 3)]];
        let mut frame = json!({ "file_path": name, "transform_matrix": [row(0), row(1), row(2), row(3)] });
        if index == 0 {
            frame["depth_file_path"] = json!("truth.png");
        }
        frames.push(frame);
    }
    let camera = sample.camera;
    let capture = json!({ "pixel_centres": "integers", "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx,
        "cy": camera.cy, "frames": frames });
    fs::write(room.join("transforms.json"), capture.to_string()).unwrap();
    fs::write(room.join("scene.json"), "{}").unwrap();
    write_png16(room.join("truth.png"), sample.depth.view(), 1000.0).unwrap();
    let short = "[nerf.train]\nsteps = 30\nrays = 128\nwarm-up = 4\n[nerf.sampling]\ncoarse = 8\nfine = 8\n";
    fs::write(place.join("short.toml"), short).unwrap();
    mde(place, &format!("eval data --dataset posed --methods multi-view:short.toml {MODEL} -o scored"));
    let refine =
        "refine data/room/0.png --views data/room/transforms.json --config short.toml --unit capture";
    mde(place, &format!("{refine} {MODEL} -o several"));
    assert_same(place, "scored/scenes/room/short", "several");
}
