//! What `mde eval` scores is what `mde refine` writes, byte for byte.

use crate::common::{Place, copy, fixture, on_disk, rendered};
use mde_cli::mde_prior::format::write_png16;
use mde_eval::scene::Room;
use serde_json::json;

/// Its depth is the brightness.
const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth -q";

/// Compares the maps of a method in `scored` with those in `refined`.
fn assert_same(place: &Place, scored: &str, refined: &str) {
    for map in ["depth.npy", "sigma.npy"] {
        let bytes = |folder: &str| place.bytes(&format!("{folder}/{map}"));
        assert!(bytes(scored) == bytes(refined), "{scored} {map}");
    }
}

#[test]
fn one_photograph() {
    let place = Place::new();
    place.take(fixture("grey_nchw.onnx"), "grey.onnx");
    place.take("image.png", "data/room/color.png");
    place.take("depth.npy", "data/room/depth.npy");
    let camera = place.scene.camera;
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
    let room = rendered(Room::Study, 3, [64, 48]);
    let place = on_disk(&room);
    copy(&place.path("images"), &place.path("data/room/images"));
    write_png16(place.path("data/room/truth.png"), room.truth.view(), 1000.0).unwrap();
    let mut capture = place.json("transforms.json");
    capture["frames"][0]["depth_file_path"] = json!("truth.png");
    place.write("data/room/transforms.json", capture.to_string());
    place.write("data/room/scene.json", "{}");
    place.run(&format!("eval data --dataset posed --methods multi-view:quick.toml {MODEL} -o scored"));
    let refine =
        "refine data/room/images/0.png --views data/room/transforms.json --config quick.toml --unit capture";
    place.run(&format!("{refine} {MODEL} -o several"));
    assert_same(&place, "scored/scenes/room/quick", "several");
}
