//! Data sets in folders made here, and the real ones where they lie beside the project.
#![allow(clippy::unwrap_used, clippy::panic)]

use mde_eval::Error;
use mde_eval::data::{DataSet, Fallback, PlainFolders, Rooms, SunDepth, SunRgbd};
use mde_eval::mde_prior::format::{sunrgbd_encode, write_npy};
use mde_eval::mde_prior::photo::write_image;
use mde_eval::ndarray::{Array2, Array3};
use std::fs;
use std::path::{Path, PathBuf};

fn truth() -> Array2<f32> {
    Array2::from_shape_fn((6, 8), |(y, x)| if x == 0 { 0.0 } else { 1.0 + 0.125 * (x + y) as f32 })
}

fn sun_scene(root: &Path, name: &str, intrinsics: Option<&str>) -> PathBuf {
    let scene = root.join(name);
    for folder in ["image", "depth"] {
        fs::create_dir_all(scene.join(folder)).unwrap();
    }
    write_image(scene.join("image/a.png"), Array3::from_elem((6, 8, 3), 0.5).view()).unwrap();
    let path = scene.join("depth/a.png");
    write_sun(&path, &truth());
    if let Some(text) = intrinsics {
        fs::write(scene.join("intrinsics.txt"), text).unwrap();
    }
    scene
}

/// A depth PNG with SUN RGB-D's rotated bits.
fn write_sun(path: &Path, depth: &Array2<f32>) {
    // The linear writer with a scale of 1 stores each value as it is.
    let raw = depth.mapv(|z| f32::from(sunrgbd_encode((z * 1000.0).round() as u16)));
    mde_eval::mde_prior::format::write_png16(path, raw.view(), 1.0).unwrap();
}

const MATRIX: &str = "500 0 4.5\n0 501 3.5\n0 0 1\n";

#[test]
fn sun_scenes_are_found_and_read() {
    let root = tempfile::tempdir().unwrap();
    sun_scene(root.path(), "kv2/b/deep", Some(MATRIX));
    sun_scene(root.path(), "kv1/a", Some("1 0 1 0 1 1 0 0 1"));
    let data = SunRgbd::open(root.path()).unwrap();
    assert_eq!(data.ids(), ["kv1/a", "kv2/b/deep"]);
    let sample = data.load(1).unwrap();
    assert_eq!(sample.depth, truth());
    assert_eq!(sample.image.dim(), (6, 8, 3));
    let camera = sample.camera;
    assert_eq!([camera.fx, camera.fy, camera.cx, camera.cy], [500.0, 501.0, 3.5, 2.5]);
    assert!(!sample.assumed_camera && sample.trusted_depth == 8.0);
    assert!(matches!(data.load(2), Err(Error::Scene { index: 2, count: 2 })));
    // No filled depth was made.
    assert!(matches!(data.with_depth(SunDepth::Filled).load(0), Err(Error::Layout { .. })));
}

#[test]
fn missing_intrinsics_are_an_error_that_can_be_overridden() {
    let root = tempfile::tempdir().unwrap();
    sun_scene(root.path(), "a", None);
    let data = SunRgbd::open(root.path()).unwrap();
    let Err(Error::Intrinsics { scene, file: "intrinsics.txt" }) = data.load(0) else { panic!() };
    assert_eq!(scene, "a");
    let sample = data.clone().with_fallback(Fallback::FieldOfView(60.0)).load(0).unwrap();
    assert!(sample.assumed_camera && sample.camera.width == 8 && sample.camera.cx == 3.5);
    let named = Fallback::Intrinsics { fx: 5.0, fy: 6.0, cx: 1.0, cy: 2.0 };
    assert_eq!(data.clone().with_fallback(named).load(0).unwrap().camera.fy, 6.0);
    assert!(matches!(data.with_fallback(Fallback::FieldOfView(0.0)).load(0), Err(Error::Camera(_))));
}

#[test]
fn broken_sun_scenes_are_named() {
    let root = tempfile::tempdir().unwrap();
    assert!(matches!(SunRgbd::open(root.path()), Err(Error::Layout { .. })));
    assert!(matches!(SunRgbd::open(root.path().join("none")), Err(Error::Io { .. })));
    let scene = sun_scene(root.path(), "a", Some("1 2 3"));
    let data = SunRgbd::open(root.path()).unwrap();
    assert!(data.load(0).unwrap_err().to_string().contains("intrinsics.txt"));
    write_sun(&scene.join("depth/a.png"), &Array2::ones((5, 8)));
    assert!(data.load(0).unwrap_err().to_string().contains("8x5"));
    write_sun(&scene.join("depth/b.png"), &truth());
    assert!(data.load(0).unwrap_err().to_string().contains("2 files"));
}

#[test]
fn plain_folders_are_found_and_read() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("mine");
    fs::create_dir_all(&folder).unwrap();
    write_image(folder.join("color.png"), Array3::from_elem((6, 8, 3), 0.25).view()).unwrap();
    write_npy(folder.join("depth.npy"), truth().mapv(|z| z * 100.0).view()).unwrap();
    let describe = |text: &str| fs::write(folder.join("scene.json"), text).unwrap();
    describe(
        r#"{"depth_units_per_metre": 100, "fx": 10, "fy": 11, "cx": 3, "cy": 2, "max_depth": 4.5, "source": "me"}"#,
    );
    let data = PlainFolders::open(root.path()).unwrap();
    let sample = data.load(0).unwrap();
    assert_eq!((sample.id.as_str(), sample.trusted_depth, sample.camera.fy), ("mine", 4.5, 11.0));
    assert!(sample.depth.iter().zip(&truth()).all(|(a, b)| (a - b).abs() < 1e-6));

    describe(r#"{"depth_units_per_metre": 100}"#);
    assert!(matches!(data.load(0), Err(Error::Intrinsics { .. })));
    assert!(data.clone().with_fallback(Fallback::FieldOfView(50.0)).load(0).unwrap().assumed_camera);
    for broken in [r#"{"fx": 3}"#, "{", r#"{"max_depth": -1}"#, r#"{"depth_units_per_metre": 0}"#] {
        describe(broken);
        assert!(data.load(0).is_err(), "{broken}");
    }
    assert!(matches!(PlainFolders::open(root.path().join("mine/none")), Err(Error::Io { .. })));
}

#[test]
fn the_rooms_are_a_data_set() {
    let rooms = Rooms::new(3, 24, 18);
    assert_eq!(rooms.len(), 7);
    assert!(!rooms.is_empty());
    let sample = rooms.load(0).unwrap();
    assert_eq!((sample.id.as_str(), sample.depth.dim()), ("study-3", (18, 24)));
    assert!(rooms.load(7).is_err());
}

#[test]
#[allow(clippy::print_stderr)]
fn the_real_data_loads() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    if !root.is_dir() {
        eprintln!("skipped: no data beside the project");
        return;
    }
    let sun = SunRgbd::open(root.join("SUNRGBD")).unwrap().with_fallback(Fallback::FieldOfView(57.0));
    let plain = PlainFolders::open(root.join("plain")).unwrap();
    assert!(sun.ids().contains(&"kv2/0000144".to_owned()));
    for data in [&sun as &dyn DataSet, &plain] {
        for index in 0..data.len() {
            let sample = data.load(index).unwrap();
            let known: Vec<f32> = sample.depth.iter().copied().filter(|&z| z > 0.0).collect();
            let share = known.len() as f64 / sample.depth.len() as f64;
            let median = mde_eval::mde_warp::median(known).unwrap();
            // A wrong decoding is off by a factor of eight.
            assert!(share > 0.3 && (0.8..8.0).contains(&median), "{}: {share} {median}", sample.id);
            assert_eq!(sample.camera.dim(), sample.depth.dim());
            assert_eq!(sample.assumed_camera, sample.id.starts_with("unknown_sensor"));
        }
    }
}
