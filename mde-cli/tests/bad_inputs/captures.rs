//! Several photographs.

use crate::common::{HEIGHT, Place, WIDTH};
use crate::table::{Case, check, misused, refused, works};
use serde_json::{Value, json};
use std::fs;

/// Photographs, captures with one fault each, and a folder of what is none.
pub(crate) fn captures(place: &Place) {
    let folder = |name: &str| {
        fs::create_dir_all(place.path(name)).unwrap();
        place.path(name)
    };
    let photographs = folder("shots");
    for name in ["a.png", "b.png", "c.png"] {
        fs::copy(place.path("image.png"), photographs.join(name)).unwrap();
    }
    fs::copy(place.path("image.png"), folder("alone").join("a.png")).unwrap();
    fs::write(folder("notes").join("notes.txt"), "none").unwrap();
    fs::write(photographs.join("torn.jpg"), "no photograph").unwrap();

    let frame = |name: &str, x: f64| {
        json!({ "file_path": name, "transform_matrix":
            [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]] })
    };
    let whole = || {
        json!({ "fl_x": 60.0, "fl_y": 60.0, "cx": 31.5, "cy": 23.5, "w": WIDTH, "h": HEIGHT,
            "frames": [frame("shots/a.png", 0.0), frame("shots/b.png", 0.1), frame("shots/c.png", 0.2)] })
    };
    let write = |name: &str, change: &dyn Fn(&mut Value)| {
        let mut value = whole();
        change(&mut value);
        place.write(name, value.to_string());
    };
    write("capture.json", &|_| ());
    write("one.json", &|v| v["frames"].as_array_mut().unwrap().truncate(1));
    write("none.json", &|v| v["frames"] = json!([]));
    write("unframed.json", &|v| v["frames"] = json!(3));
    write("still.json", &|v| {
        for index in 0..3 {
            v["frames"][index]["transform_matrix"][0][3] = json!(0.5);
        }
    });
    write("sized-otherwise.json", &|v| v["w"] = json!(2 * WIDTH));
    write("singular.json", &|v| v["frames"][1]["transform_matrix"][0][0] = json!(0.0));
    write("mirrored.json", &|v| v["frames"][1]["transform_matrix"][0][0] = json!(-1.0));
    write("lettered.json", &|v| v["frames"][1]["transform_matrix"][0][0] = json!("one"));
    write("missing.json", &|v| v["frames"][2]["file_path"] = json!("shots/gone.png"));
    write("torn.json", &|v| v["frames"][2]["file_path"] = json!("shots/torn.jpg"));
    write("blind.json", &|v| v["fl_x"] = json!(0.0));
    write("fisheye.json", &|v| v["camera_model"] = json!("OPENCV_FISHEYE"));
    write("elsewhere.json", &|v| v["frames"][0]["file_path"] = json!("image.png"));
    place.write("cut.json", "{\"frames\": [");
    fs::write(place.path("bytes.json"), [0xff, 0xfe, 0x00]).unwrap();
}

fn refine(views: &str) -> String {
    format!("refine shots/a.png --prior-depth depth.npy --views {views}")
}

#[test]
pub(crate) fn captures_that_are_none() {
    let poses = |rest: &str| format!("poses {rest} --prior-depth depth.npy --fov 60");
    let cases: Vec<Case> = vec![
        refused(refine("one.json"), &["one.json", "at least 2"]),
        refused(refine("none.json"), &["none.json", "at least 2"]),
        refused(refine("unframed.json"), &["unframed.json", "frames"]),
        refused(refine("still.json"), &["still.json", "from one place", "add some"]),
        refused(refine("sized-otherwise.json"), &["sized-otherwise.json", "a.png", "64x48", "128x48"]),
        refused(refine("singular.json"), &["singular.json", "b.png", "singular"]),
        refused(refine("mirrored.json"), &["mirrored.json", "b.png", "reflection"]),
        refused(refine("lettered.json"), &["lettered.json", "frames[1]", "finite numbers"]),
        refused(refine("missing.json"), &["missing.json", "gone.png", "missing"]),
        refused(refine("torn.json"), &["torn.jpg"]),
        refused(refine("blind.json"), &["blind.json", "frames[0]"]),
        refused(refine("fisheye.json"), &["fisheye.json", "OPENCV_FISHEYE", "undistort"]),
        refused(refine("elsewhere.json"), &["shots/a.png", "not a photograph of this capture"]),
        refused(refine("cut.json"), &["cut.json", "JSON"]),
        refused(refine("bytes.json"), &["bytes.json", "not UTF-8"]),
        refused(refine("nowhere"), &["nowhere", "no such photograph"]),
        refused(refine("nowhere.json"), &["nowhere.json", "no such photograph"]),
        refused(refine("notes"), &["no photograph but", "one or more others"]),
        refused(refine("shots/a.png"), &["no photograph but", "one or more others"]),
        refused(refine("shots"), &["torn.jpg", "give a JPEG, PNG, TIFF, BMP or WebP"]),
        refused(refine("image.png dot.png"), &["dot.png", "1x1"]),
        refused(refine("shots/b.png --unit capture"), &["no poses of their own", "--unit prior"]),
        refused(poses("nowhere a.png"), &["nowhere", "no such photograph"]),
        refused(poses("shots/a.png"), &["shots/a.png", "two or more"]),
        refused(poses("alone"), &["a.png", "two or more"]),
        refused(poses("notes"), &["two or more"]),
        refused(poses("shots"), &["torn.jpg"]),
        refused(poses("shots/a.png black.png -q -o no/found.json"), &["no poses were found", "black.png"]),
        refused(poses("shots/a.png shots/b.png -q -o no/found.json"), &["no poses were found", "b.png"]),
        refused(poses("shots/a.png shots/b.png -q -o folder.png"), &["folder.png", "is a folder"]),
        refused(poses("shots/a.png shots/b.png -q -o empty.txt"), &["empty.txt", "--force"]),
    ];
    check(&cases);
}

/// The photographs carry no depth: the reference is refined alone, and the record has the reason.
#[test]
pub(crate) fn photographs_without_parallax_leave_the_reference_alone() {
    let refine = |views: &str| works(format!("{} --fov 60 --no-nerf", refine(views)));
    check(&[
        refine("shots/b.png"),
        refine("shots/b.png shots/c.png"),
        refine("black.png"),
        refine("picture.png"),
    ]);
}

#[test]
pub(crate) fn wrong_usage_of_several_photographs() {
    let of = |rest: &str, told: &[&'static str]| {
        misused(format!("refine image.png --prior-depth depth.npy {rest} -o out"), told)
    };
    check(&[
        of("--views", &["--views"]),
        misused("refine image.png --prior-model fastdepth.onnx --all -o out", &["--views"]),
        of("--max-views 3", &["--views"]),
        of("--unit prior", &["--views"]),
        of("--views shots --max-views 1", &["2..=64"]),
        of("--views shots --unit feet", &["feet", "capture"]),
        of("--views shots --all", &["cannot be used with"]),
        misused("poses -o found.json", &["PHOTO"]),
        misused("poses shots -o found.json", &["--prior-model", "--prior-depth"]),
    ]);
}

/// Names are bytes on Linux: they are shown as well as possible, and only a file of JSON can't have them.
#[test]
#[cfg(target_os = "linux")]
fn names_that_are_not_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let place = crate::inputs::place();
    let odd = place.path(".").join(std::ffi::OsStr::from_bytes(b"b\xff.png"));
    fs::copy(place.path("image.png"), &odd).unwrap();
    let run = |arguments: &str| {
        let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_mde"));
        command.current_dir(place.path(".")).args(arguments.split_whitespace()).arg(&odd).assert()
    };
    run("refine shots/a.png --prior-depth depth.npy --fov 60 --no-nerf -q -o out --views").success();
    let refused = run("poses shots/a.png --prior-depth depth.npy --fov 60 -q -o found.json").failure();
    let message = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(message.contains("not UTF-8") && message.lines().count() == 1, "{message}");
}
