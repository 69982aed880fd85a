//! What `mde eval` scores is what `mde refine` writes, byte for byte.

use crate::common::{Place, fixture};
use mde_cli::mde_prior::format::{write_npy, write_png16};
use mde_cli::mde_prior::photo::write_image;
use mde_cli::mde_warp::Pose;
use mde_eval::data::{DataSetKind, Options, Sample, open};
use serde_json::json;

const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth -q";

/// A small capture of a room, its reference and further photographs; and a folder with `grey.onnx`, whose depth is the brightness.
fn place() -> (Place, Sample) {
    let options = Options { size: Some([64, 48]), ..Options::default() };
    let sample = open(DataSetKind::Captures, None, &options).unwrap().load(0).unwrap();
    let place = Place::new();
    place.take(fixture("grey_nchw.onnx"), "grey.onnx");
    place.write("data/room/scene.json", "{}");
    (place, sample)
}

/// Compares the maps of a method in `scored` with those in `refined`.
fn assert_same(place: &Place, scored: &str, refined: &str) {
    for map in ["depth.npy", "sigma.npy"] {
        let bytes = |folder: &str| place.bytes(&format!("{folder}/{map}"));
        assert!(bytes(scored) == bytes(refined), "{scored} {map}");
    }
}

#[test]
fn one_photograph() {
    let (place, sample) = place();
    write_image(place.path("data/room/color.png"), sample.image.view()).unwrap();
    write_npy(place.path("data/room/depth.npy"), sample.depth.view()).unwrap();
    let camera = sample.camera;
    let about = json!({ "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy }).to_string();
    place.write("data/room/scene.json", &about);
    place.write("intrinsics.json", &about);
    place.run(&format!("eval data --methods default,fast {MODEL} -o scored"));
    for preset in ["default", "fast"] {
        let refine = format!("refine data/room/color.png --intrinsics intrinsics.json --preset {preset}");
        place.run(&format!("{refine} {MODEL} -o {preset}"));
        assert_same(&place, &format!("scored/scenes/room/{preset}"), preset);
    }
}

#[test]
fn several_photographs_with_poses() {
    let (place, sample) = place();
    let further = sample.views.iter().map(|captured| (&captured.view.image, captured.view.pose));
    let mut frames = Vec::new();
    for (image, pose) in std::iter::once((&sample.image, Pose::identity())).chain(further) {
        let name = format!("{}.png", frames.len());
        write_image(place.path(&format!("data/room/{name}")), image.view()).unwrap();
        // Camera to world, with OpenGL's axes.
        let matrix = pose.inverse().to_homogeneous();
        let row = |y: usize| [matrix[(y, 0)], -matrix[(y, 1)], -matrix[(y, 2)], matrix[(y, 3)]];
        let mut frame = json!({ "file_path": name, "transform_matrix": [row(0), row(1), row(2), row(3)] });
        if frames.is_empty() {
            frame["depth_file_path"] = json!("truth.png");
        }
        frames.push(frame);
    }
    let camera = sample.camera;
    let capture = json!({ "pixel_centres": "integers", "w": camera.width, "h": camera.height, "fl_x": camera.fx,
        "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy, "frames": frames });
    place.write("data/room/transforms.json", capture.to_string());
    write_png16(place.path("data/room/truth.png"), sample.depth.view(), 1000.0).unwrap();
    let short = "[nerf.train]\nsteps = 30\nrays = 128\nwarm-up = 4\n[nerf.sampling]\ncoarse = 8\nfine = 8\n";
    place.write("short.toml", short);
    place.run(&format!("eval data --dataset posed --methods multi-view:short.toml {MODEL} -o scored"));
    let refine =
        "refine data/room/0.png --views data/room/transforms.json --config short.toml --unit capture";
    place.run(&format!("{refine} {MODEL} -o several"));
    assert_same(&place, "scored/scenes/room/short", "several");
}
