//! Data sets in folders made here, and the real ones where they lie beside the project.

use mde_eval::data::{
    CaptureGrid, Captures, DataSet, DataSetKind, Nyu, Options, PlainFolders, Posed, Resized, Rooms, SunRgbd,
    open,
};
use mde_eval::mde_prior::format::{write_npy, write_png16};
use mde_eval::mde_prior::photo::write_image;
use mde_eval::mde_uncertainty::statistics::median;
use mde_eval::ndarray::{Array2, Array3};
use mde_eval::{Error, Result};
use std::fs;
use std::path::Path;

fn truth() -> Array2<f32> {
    Array2::from_shape_fn((6, 8), |(y, x)| if x == 0 { 0.0 } else { 1.0 + 0.125 * (x + y) as f32 })
}

/// The message of an error.
fn told<T>(result: Result<T>) -> String {
    result.err().unwrap().to_string()
}

/// A scene of SUN RGB-D, whose depth PNG has its bits rotated.
fn sun_scene(root: &Path, name: &str) {
    let scene = root.join(name);
    for folder in ["image", "depth"] {
        fs::create_dir_all(scene.join(folder)).unwrap();
    }
    write_image(scene.join("image/a.png"), Array3::from_elem((6, 8, 3), 0.5).view()).unwrap();
    // The linear writer with a scale of 1 stores each value as it is.
    let raw = truth().mapv(|z| f32::from(((z * 1000.0).round() as u16).rotate_left(3)));
    write_png16(scene.join("depth/a.png"), raw.view(), 1.0).unwrap();
    fs::write(scene.join("intrinsics.txt"), "500 0 4.5\n0 501 3.5\n0 0 1\n").unwrap();
}

#[test]
fn sun_scenes_of_all_sensors_are_found_and_read() {
    let root = tempfile::tempdir().unwrap();
    let lobby = "xtion/sun3ddata/inn/lobby";
    let [first, second] = ["01", "02"].map(|frame| format!("{lobby}/{frame}"));
    let scenes = ["kv1/NYUdata/NYU0001", "kv2/000002", "realsense/lg/0003", &first, &second];
    scenes.iter().for_each(|scene| sun_scene(root.path(), scene));
    let data = SunRgbd::open(root.path(), None).unwrap();
    assert_eq!(data.ids(), scenes);
    assert_eq!(DataSetKind::guess(root.path()).unwrap(), DataSetKind::SunRgbd);
    for index in 0..scenes.len() {
        let sample = data.load(index).unwrap();
        assert_eq!((sample.depth, sample.image.dim()), (truth(), (6, 8, 3)));
        let camera = sample.camera;
        assert_eq!([camera.fx, camera.fy, camera.cx, camera.cy], [500.0, 501.0, 3.5, 2.5]);
        assert!(!sample.assumed_camera && sample.trusted_depth == 8.0);
    }
    assert!(matches!(data.load(5), Err(Error::Scene { index: 5, count: 5 })));
    // The place is a recording's.
    let places = [data.place(1), data.place(3), data.place(4), data.place(5)];
    assert_eq!(places, [Some("kv2/000002"), Some(lobby), Some(lobby), None]);
    let options = Options { size: Some([4, 3]), ..Options::default() };
    let resized = open(DataSetKind::SunRgbd, Some(root.path()), &options).unwrap();
    assert_eq!([resized.place(1), resized.place(3)], [Some("kv2/000002"), Some(lobby)]);
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
    let open = |fov| PlainFolders::open(root.path(), fov).unwrap();
    let data = open(None);
    let sample = data.load(0).unwrap();
    assert_eq!((sample.id.as_str(), sample.trusted_depth, sample.camera.fy), ("mine", 4.5, 11.0));
    assert!(sample.depth.iter().zip(&truth()).all(|(a, b)| (a - b).abs() < 1e-6));

    describe(r#"{"depth_units_per_metre": 100}"#);
    assert!(told(data.load(0)).contains("assume a field of view"));
    assert!(open(Some(50.0)).load(0).unwrap().assumed_camera);
    assert!(matches!(PlainFolders::open(root.path().join("mine/none"), None), Err(Error::Io { .. })));
}

#[test]
fn captures_are_a_data_set_of_every_combination() {
    let grid = CaptureGrid {
        views: vec![2, 3, 5, 8],
        baselines: vec![0.02, 0.2],
        pose_noises: vec![0.0, 0.1, 1.0],
        gains: vec![0.0, 0.2],
    };
    let all = Captures::new(&grid, 0, 16, 12).unwrap();
    assert_eq!(all.ids().len(), 7 * 4 * 2 * 3 * 2);
    let unique: std::collections::BTreeSet<_> = all.ids().iter().collect();
    assert_eq!(unique.len(), all.ids().len());
    let places: std::collections::BTreeSet<_> =
        (0..all.ids().len()).filter_map(|index| all.place(index)).collect();
    assert_eq!(places.len(), 7);

    let grid = CaptureGrid { views: vec![3], pose_noises: vec![0.0, 1.0], ..CaptureGrid::default() };
    let few = Captures::new(&grid, 3, 24, 18).unwrap();
    let (exact, noisy) = (few.load(0).unwrap(), few.load(1).unwrap());
    assert_eq!((few.ids().len(), exact.views.len(), exact.depth.dim()), (14, 2, (18, 24)));
    assert_eq!((&exact.image, &exact.depth, &exact.prior), (&noisy.image, &noisy.depth, &noisy.prior));
    let rooms = Rooms::new(3, 24, 18);
    let room = rooms.load(0).unwrap();
    assert_eq!((room.id.as_str(), room.image), ("study-3", exact.image));
    assert!(rooms.ids().len() == 7 && rooms.load(7).is_err());
    assert_ne!(exact.views[0].view.pose, noisy.views[0].view.pose);

    let small = Resized::new(Box::new(few), 12, 9).unwrap().load(0).unwrap();
    for captured in &small.views {
        assert_eq!((captured.view.image.dim(), captured.view.mask.dim()), ((9, 12, 3), (9, 12)));
        assert_eq!(captured.prior.as_ref().unwrap().map.dim(), (9, 12));
        assert_eq!(captured.view.camera, small.camera);
        captured.view.validate().unwrap();
    }
}

/// An image and a depth map in millimetres under names below `root`.
fn pair(root: &Path, image: &str, depth: &str, size: (usize, usize)) {
    for path in [image, depth] {
        fs::create_dir_all(root.join(path).parent().unwrap()).unwrap();
    }
    write_image(root.join(image), Array3::from_elem((size.0, size.1, 3), 0.5).view()).unwrap();
    let map =
        Array2::from_shape_fn(size, |(y, x)| if x == 0 { 0.0 } else { 1000.0 + (y % 4) as f32 * 500.0 });
    write_png16(root.join(depth), map.view(), 1.0).unwrap();
}

#[test]
fn nyu_pairs_are_found_in_both_layouts() {
    let root = tempfile::tempdir().unwrap();
    pair(root.path(), "kitchen/rgb_00045.png", "kitchen/sync_depth_00045.png", (48, 64));
    pair(root.path(), "kitchen/rgb_00046.png", "kitchen/sync_depth_00047.png", (48, 64));
    pair(root.path(), "labelled/rgb/0001.png", "labelled/depth/1.png", (480, 640));
    let data = Nyu::open(root.path()).unwrap();
    assert_eq!(data.ids(), ["kitchen/rgb_00045", "labelled/0001"]);
    let small = data.load(0).unwrap();
    assert_eq!((small.depth[(1, 3)], small.depth[(1, 0)], small.trusted_depth), (1.5, 0.0, 10.0));
    let camera = data.load(1).unwrap().camera;
    assert!((camera.fx - 518.8579).abs() < 1e-3 && (camera.cx - 324.5824).abs() < 1e-3);
    assert!(!small.assumed_camera && (small.camera.fx - camera.fx / 10.0).abs() < 1e-9);
    assert_eq!(DataSetKind::guess(&root.path().join("kitchen")).unwrap(), DataSetKind::Nyu);
    let places = [data.place(0), data.place(1)];
    assert_eq!(places, [Some("kitchen"), Some("labelled/0001")]);
    assert!(told(DataSetKind::guess(&root.path().join("labelled"))).contains("nyu"));
    pair(root.path(), "odd/rgb/1.png", "odd/depth/1.png", (40, 64));
    assert!(told(Nyu::open(root.path().join("odd")).unwrap().load(0)).contains("64x40"));
    assert!(told(Nyu::open(root.path().join("nyu_depth_v2_labeled.mat"))).contains("export"));
    assert!(matches!(Nyu::open(root.path().join("kitchen/none")), Err(Error::Io { .. })));
}

#[test]
fn resizing_mixes_no_depths_and_moves_the_camera() {
    let root = tempfile::tempdir().unwrap();
    sun_scene(root.path(), "a");
    let plain = SunRgbd::open(root.path(), None).unwrap();
    let original = plain.load(0).unwrap();
    for (width, height) in [(16, 12), (4, 3), (5, 7), (8, 6), (1, 1)] {
        let sample = Resized::new(Box::new(plain.clone()), width, height).unwrap().load(0).unwrap();
        assert_eq!((sample.depth.dim(), sample.image.dim()), ((height, width), (height, width, 3)));
        assert!(sample.depth.iter().all(|z| original.depth.iter().any(|o| o == z)));
        let scale = width as f64 / 8.0;
        assert!((sample.camera.fx - 500.0 * scale).abs() < 1e-9);
        assert!((sample.camera.cx - ((3.5 + 0.5) * scale - 0.5)).abs() < 1e-9);
    }
    assert!(Resized::new(Box::new(plain), 0, 3).is_err());
}

#[test]
fn posed_captures_have_the_truth_of_their_reference_alone() {
    let root = tempfile::tempdir().unwrap();
    let scene = root.path().join("kitchen/a");
    fs::create_dir_all(scene.join("images")).unwrap();
    let mut transforms = serde_json::json!({
        "camera_model": "OPENCV", "fl_x": 8.0, "fl_y": 8.0, "cx": 3.5, "cy": 2.5, "w": 8, "h": 6,
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "depth_units_per_metre": 1000, "frames": [],
    });
    for index in 0..3 {
        let name = format!("images/{index}.png");
        write_image(scene.join(&name), Array3::from_elem((6, 8, 3), 0.25 * index as f32).view()).unwrap();
        // No depth file but the reference's is there.
        transforms["frames"].as_array_mut().unwrap().push(serde_json::json!({
            "file_path": name, "depth_file_path": format!("depth/{index}.png"),
            // OpenGL axes, that much to the right.
            "transform_matrix": [[1, 0, 0, 0.1 * f64::from(index)], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }));
    }
    fs::create_dir_all(scene.join("depth")).unwrap();
    let depth = truth().mapv(|z| (1000.0 * z).round());
    write_png16(scene.join("depth/1.png"), depth.view(), 1.0).unwrap();
    let write = |transforms: &serde_json::Value, description: &str| {
        fs::write(scene.join("transforms.json"), transforms.to_string()).unwrap();
        fs::write(scene.join("scene.json"), description).unwrap();
    };
    write(&transforms, r#"{"reference": 1, "extra_views": [2, 0], "licence": "CC0", "summary": {}}"#);
    let open = |pose_noise| Posed::open(root.path(), pose_noise);
    let data = open(0.0).unwrap();
    assert_eq!((data.ids(), data.place(0)), (["kitchen/a".to_owned()].as_slice(), Some("kitchen")));
    assert_eq!(DataSetKind::guess(root.path()).unwrap(), DataSetKind::Posed);
    let capture = data.capture(0).unwrap();
    assert_eq!((capture.trusted_depth, &capture.truth), (10.0, &truth()));
    // The world is the reference's camera, with y down and z forward; photographs come in the order of scene.json.
    let centres: Vec<f64> = capture.views.iter().map(|v| v.view.pose.inverse().translation.x).collect();
    assert!(centres.iter().zip([0.0, 0.1, -0.1]).all(|(a, b)| (a - b).abs() < 1e-12), "{centres:?}");
    let sample = data.load(0).unwrap();
    let shades: Vec<f32> = sample.views.iter().map(|v| v.view.image[[0, 0, 0]]).collect();
    assert!(
        (shades[0] - 0.5).abs() < 0.01 && shades[1] == 0.0 && (sample.image[[0, 0, 0]] - 0.25).abs() < 0.01
    );
    assert_eq!((sample.camera.fx, sample.depth), (8.0, truth()));

    // Errors of the poses of the further photographs, as rendered captures have them; the same each time.
    let off = open(0.5).unwrap().capture(0).unwrap();
    assert_eq!(off, open(0.5).unwrap().capture(0).unwrap());
    assert_eq!(off.views[0], capture.views[0]);
    assert_ne!(off.views[1..], capture.views[1..]);
    assert!(open(f64::NAN).is_err());

    // With distortion, photograph and truth are resampled alike: towards the border further out.
    transforms["k1"] = 0.5.into();
    write(&transforms, r#"{"reference": 1, "max_depth": 3}"#);
    let bent = data.capture(0).unwrap();
    assert_eq!((bent.trusted_depth, bent.views.len()), (3.0, 3));
    assert!(bent.truth.iter().all(|z| *z == 0.0 || truth().iter().any(|t| t == z)));
    assert_eq!(bent.truth[[2, 4]], truth()[[2, 4]]);
    assert_eq!(bent.truth[[0, 7]], 0.0);
    assert!(!bent.views[0].view.mask[[0, 7]] && bent.views[0].view.mask[[2, 4]]);

    for (description, word) in [
        (r#"{"reference": 5}"#, "frame 5"),
        (r#"{"reference": 0}"#, "depth/0.png"),
        (r#"{"max_depth": -1}"#, "max_depth"),
        ("{", "scene.json"),
    ] {
        write(&transforms, description);
        assert!(told(data.load(0)).contains(word), "{description}");
    }
    fs::remove_file(scene.join("images/2.png")).unwrap();
    write(&transforms, "{}");
    assert!(told(data.load(0)).contains("2.png"));
    assert!(matches!(Posed::open(root.path().join("kitchen/a/images"), 0.0), Err(Error::Layout { .. })));
}

/// `MDE_SHARED=FOLDER cargo test -p mde-eval --test it -- --ignored`, with FOLDER/data/SUNRGBD and FOLDER/data/plain.
#[test]
#[ignore = "reads the folder that MDE_SHARED names"]
fn the_real_data_loads() {
    let shared = std::env::var_os("MDE_SHARED").expect("MDE_SHARED names the folder of the shared data");
    let root = Path::new(&shared).join("data");
    let sun = SunRgbd::open(root.join("SUNRGBD"), Some(57.0)).unwrap();
    let plain = PlainFolders::open(root.join("plain"), None).unwrap();
    let posed = Posed::open(root.join("posed"), 0.0).unwrap();
    let places: std::collections::BTreeSet<_> =
        (0..posed.ids().len()).filter_map(|index| posed.place(index)).collect();
    assert_eq!((posed.ids().len(), places.len()), (13, 5));
    for index in 0..posed.ids().len() {
        let capture = posed.capture(index).unwrap();
        let known: Vec<f64> = capture.truth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
        assert!(2 * known.len() > capture.truth.len(), "{}: {}", capture.id, known.len());
        let reach = 0.01 * median(known).unwrap();
        assert!(capture.views.len() > 4, "{}", capture.id);
        for (index, captured) in capture.views.iter().enumerate() {
            assert_eq!(captured.view.camera.dim(), capture.truth.dim());
            let away = captured.view.pose.translation.vector.norm();
            assert!(index == 0 || (reach..50.0 * reach).contains(&away), "{}: {away}", capture.id);
        }
    }
    assert!(sun.ids().contains(&"kv2/0000144".to_owned()));
    for data in [&sun as &dyn DataSet, &plain] {
        for index in 0..data.ids().len() {
            let sample = data.load(index).unwrap();
            let known: Vec<f32> = sample.depth.iter().copied().filter(|&z| z > 0.0).collect();
            let share = known.len() as f64 / sample.depth.len() as f64;
            let median = median(known).unwrap();
            // A wrong decoding is off by a factor of eight.
            assert!(share > 0.3 && (0.8..8.0).contains(&median), "{}: {share} {median}", sample.id);
            assert_eq!(sample.camera.dim(), sample.depth.dim());
            assert_eq!(sample.assumed_camera, sample.id.starts_with("unknown_sensor"));
        }
    }
}
