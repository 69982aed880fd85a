use std::path::Path;

use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Isometry3, Point2, Vector3};
use ndarray::Array3;
use proptest::prelude::*;

use super::*;

const SIZE: [usize; 2] = [64, 48];

fn present(path: &Path) -> Option<[usize; 2]> {
    (!path.to_string_lossy().contains("gone")).then_some(SIZE)
}

fn frames() -> Vec<Frame> {
    let camera = PinholeCamera::new(50.0, 51.0, 31.0, 24.5, 64, 48).unwrap();
    let distortion = Distortion { k1: 0.1, k2: -0.02, k3: 0.001, p1: 0.002, p2: -0.001 };
    let pose = |x: f64| Pose::from(Isometry3::new(Vector3::new(x, 0.2, -0.1), Vector3::new(0.1, x, -0.2)));
    let (lens, folder) = (Lens { camera, distortion }, Path::new("shots"));
    let frame = |(name, x)| Frame { photograph: folder.join(name), lens, pose: pose(x) };
    [("a.png", 0.0), ("b/c.png", 0.5), ("d.png", -0.3)].map(frame).to_vec()
}

fn close(a: &PosedCapture, b: &[Frame]) -> bool {
    let same = |(a, b): (&Frame, &Frame)| {
        let (own, other) = (&a.lens.camera, &b.lens.camera);
        let camera = (own.cx - other.cx).abs() + (own.cy - other.cy).abs();
        let (p, q) = (a.pose.to_homogeneous(), b.pose.to_homogeneous());
        a.photograph == b.photograph && camera < 1e-9 && (p - q).amax() < 1e-9
    };
    a.frames.len() == b.len() && a.frames.iter().zip(b).all(same)
}

fn transforms(text: &str) -> Result<PosedCapture> {
    transforms::parse(Path::new("shots/transforms.json"), text, PixelCentres::Integers, &present)
}

fn written(frames: &[Frame]) -> String {
    transforms_json(frames, Path::new("shots"), |_| Vec::new())
}

#[test]
fn transforms_come_back_as_written() {
    let frames = frames();
    let text = written(&frames);
    let read = transforms(&text).unwrap();
    assert!(close(&read, &frames));
    assert_eq!(read.frames[0].lens, frames[0].lens);
    // The file's own word on pixel centres wins over the caller's.
    let integers = text.replace("halves", "integers");
    let read = transforms(&integers).unwrap();
    assert!((read.frames[0].lens.camera.cx - 31.5).abs() < 1e-12);
}

/// Where a camera looks along -z of OpenGL, the point ahead of it lies at positive depth and in the middle.
#[test]
fn opengl_axes_are_turned() {
    let text = r#"{"camera_angle_x": 1.0, "frames": [
        {"file_path": "a", "transform_matrix": [[1,0,0,1],[0,1,0,0],[0,0,1,5],[0,0,0,1]]},
        {"file_path": "b", "transform_matrix": [[1,0,0,2],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}]}"#;
    let capture = transforms(text).unwrap();
    let there = capture.frames[0].pose * Point3::new(1.0, 0.5, 0.0);
    assert!((there - Point3::new(0.0, -0.5, 5.0)).norm() < 1e-12);
    let camera = &capture.frames[0].lens.camera;
    assert!((camera.fx - 32.0 / 0.5_f64.tan()).abs() < 1e-12 && camera.fy == camera.fx && camera.cx == 31.5);
}

/// Each text is refused in one line that names the file and the fault: numbers that would overflow somewhere in the middle of a run too.
#[test]
fn bad_transforms_are_named() {
    let good = written(&frames());
    let with = |from: &str, to: &str| {
        let text = good.replace(from, to);
        assert_ne!(text, good);
        text
    };
    let two = |camera: &str, a: &str, b: &str| {
        let frame = |name: &str, rows: &str| {
            format!(r#"{{"file_path": "{name}.png", "transform_matrix": [{rows}, [0,0,0,1]]}}"#)
        };
        format!(r#"{{{camera}, "frames": [{}, {}]}}"#, frame("a", a), frame("b", b))
    };
    let (focal, still) = (r#""fl_x": 50"#, "[1,0,0,1],[0,1,0,0],[0,0,1,5]");
    let far = "[0.6,-0.8,0,1.7e308],[0.8,0.6,0,1.7e308],[0,0,1,0]";
    for (text, named) in [
        (with("\"fl_x\": 50.0", "\"fl_x\": null"), "frames[0].fl_x"),
        (with("\"fl_x\": 50.0", "\"fl_x\": 1e300"), "fx is 1e300"),
        (with("\"k1\": 0.1", "\"k1\": 1e300"), "k1 is 1e300"),
        (with("OPENCV", "OPEN\\rCV"), r"OPEN\rCV is not supported"),
        (with("\"w\": 64", "\"w\": 1e300"), "65536"),
        (two(r#""camera_angle_x": 1e9"#, still, still), "frames[0].camera_angle_x: 1000000000.0"),
        // The camera's centre is a sum of three products: each translation is finite, but the centre would not be.
        (two(focal, still, far), "translation is not finite or above 1e12"),
    ] {
        let message = transforms(&text).unwrap_err().to_string();
        assert!(message.starts_with("shots/transforms.json: ") && message.contains(named), "{message}");
        assert!(!message.contains(char::is_control), "{message:?}");
    }
    // A missing photograph leaves the others, as long as there are two.
    assert_eq!(transforms(&with("d.png", "gone.png")).unwrap().unreadable, [Path::new("shots/gone.png")]);
    let gone = two(focal, still, still).replace("a.png", "gone\\n\\u001b[31m.png");
    let message = transforms(&gone).unwrap_err().to_string();
    assert!(message.contains(r"gone\n\u{1b}[31m.png is missing or no image"), "{message}");
    let near = transforms(&two(focal, still, &far.replace("1.7e308", "1e12"))).unwrap();
    assert!(near.frames[1].pose.to_homogeneous().iter().all(|x| x.is_finite()));
}

#[cfg(unix)]
#[test]
fn files_that_never_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("transforms.json");
    let _ = std::fs::remove_file(&pipe);
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.as_path(), Path::new("/dev/zero")] {
        let message = read_transforms(path, PixelCentres::Halves, &present).unwrap_err().to_string();
        assert!(message.contains("give a regular file"), "{message}");
    }
}

/// A model of the frames without distortion, as text and as bytes.
fn colmap_files(frames: &[Frame]) -> ([String; 3], [Vec<u8>; 3]) {
    let camera = &frames[0].lens.camera;
    let p = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, 0.1, -0.02, 0.002, -0.001];
    let numbers: Vec<String> = p.iter().map(|x| format!("{x}")).collect();
    let cameras = format!("# comment\n7 OPENCV 64 48 {}\n", numbers.join(" "));
    let (mut images, mut points) = (String::new(), String::from("3 0.5 1.5 2.5 1 2 3 0.75 1 0 2 1\n"));
    points.push_str("4 1 0 0 1 2 3 0.75\n");
    let word = |v: u64| v.to_le_bytes().to_vec();
    let small = |v: u32| v.to_le_bytes().to_vec();
    let floats = |v: &[f64]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let camera_bytes = [word(1), small(7), small(4), word(64), word(48), floats(&p)].concat();
    let mut image_bytes = word(frames.len() as u64);
    for (i, frame) in frames.iter().enumerate() {
        let (q, t) = (frame.pose.rotation.coords, frame.pose.translation.vector);
        let row = [q.w, q.x, q.y, q.z, t.x, t.y, t.z];
        let words: Vec<String> = row.iter().map(|x| format!("{x}")).collect();
        let name = frame.photograph.strip_prefix("shots").unwrap().to_str().unwrap();
        images += &format!("{} {} 7 {name}\n10 20 -1 30 40 3\n", i + 1, words.join(" "));
        image_bytes.extend([small(i as u32 + 1), floats(&row), small(7)].concat());
        image_bytes.extend(name.as_bytes());
        image_bytes.push(0);
        image_bytes.extend([word(1), floats(&[10.0, 20.0]), word(u64::MAX)].concat());
    }
    let track = [word(2), small(1), small(0), small(2), small(1)].concat();
    let mut point_bytes =
        [word(2), word(3), floats(&[0.5, 1.5, 2.5]), vec![1, 2, 3], floats(&[0.75])].concat();
    point_bytes.extend(track);
    point_bytes.extend([word(4), floats(&[1.0, 0.0, 0.0]), vec![1, 2, 3], floats(&[0.75]), word(0)].concat());
    ([cameras, images, points], [camera_bytes, image_bytes, point_bytes])
}

fn from_text(text: &[String; 3]) -> Result<PosedCapture> {
    let path = Path::new("images.txt");
    let cameras = colmap::text_cameras(path, &text[0])?;
    let (images, points) = (colmap::text_images(path, &text[1])?, colmap::text_points(path, &text[2])?);
    colmap::Raw { cameras, images, points }.capture(path, Path::new("shots"), &present)
}

fn from_bytes(bytes: &[Vec<u8>; 3]) -> Result<PosedCapture> {
    let path = Path::new("images.bin");
    let cameras = colmap::binary_cameras(path, &bytes[0])?;
    let (images, points) = (colmap::binary_images(path, &bytes[1])?, colmap::binary_points(path, &bytes[2])?);
    colmap::Raw { cameras, images, points }.capture(path, Path::new("shots"), &present)
}

#[test]
fn colmap_models_are_read_as_text_and_as_bytes() {
    let frames = frames();
    let (text, bytes) = colmap_files(&frames);
    let read = from_text(&text).unwrap();
    assert!(close(&read, &frames));
    assert_eq!(read, from_bytes(&bytes).unwrap());
    assert_eq!(read.points[0].frames, [0, 1]);
    assert_eq!(read.points[0].position, Point3::new(0.5, 1.5, 2.5));
    assert_eq!(read.frames[0].lens.distortion.p2, -0.001);
    for (model, parameters, k1) in [
        ("SIMPLE_PINHOLE", "50 32 24", 0.0),
        ("PINHOLE", "50 50 32 24", 0.0),
        ("SIMPLE_RADIAL", "50 32 24 0.1", 0.1),
        ("RADIAL", "50 32 24 0.1 0.2", 0.1),
    ] {
        let text = format!("7 {model} 64 48 {parameters}\n");
        let lens = colmap::text_cameras(Path::new("c"), &text).unwrap()[&7];
        assert_eq!((lens.camera.fx, lens.camera.cx, lens.distortion.k1), (50.0, 31.5, k1));
    }
}

#[test]
fn a_model_on_disk_is_found_in_either_form() {
    let (text, bytes) = colmap_files(&frames());
    let folder = tempfile::tempdir().unwrap();
    let names = ["cameras", "images", "points3D"];
    for (name, text) in names.iter().zip(&text) {
        std::fs::write(folder.path().join(format!("{name}.txt")), text).unwrap();
    }
    let by_text = read_colmap(folder.path(), Path::new("shots"), &present).unwrap();
    for (name, bytes) in names.iter().zip(&bytes) {
        std::fs::write(folder.path().join(format!("{name}.bin")), bytes).unwrap();
    }
    assert_eq!(by_text, read_colmap(folder.path(), Path::new("shots"), &present).unwrap());
    let gone =
        read_colmap(&folder.path().join("gone"), Path::new("shots"), &present).unwrap_err().to_string();
    assert!(gone.contains("cameras.txt"), "{gone}");
}

#[test]
fn a_model_comes_back_as_written() {
    let mut frames = frames();
    frames.iter_mut().for_each(|frame| frame.lens.distortion = Distortion::default());
    let seen = vec![(2, [7, 5]), (0, [20, 31])];
    let point = ColmapPoint { position: Point3::new(0.25, -1.5, 2.0), colour: [1, 2, 3], seen };
    let text = colmap_text(&frames, &[point.clone(), ColmapPoint { seen: Vec::new(), ..point }]);
    assert_eq!(text.each_ref().map(|file| file.0), ["cameras.txt", "images.txt", "points3D.txt"]);
    let images = text[1].1.replace("shots/", "");
    let read = from_text(&[text[0].1.clone(), images, text[2].1.clone()]).unwrap();
    assert!(close(&read, &frames) && read.frames[0].lens == frames[0].lens);
    let SparsePoint { position, frames, .. } = &read.points[0];
    assert_eq!((position, &**frames), (&Point3::new(0.25, -1.5, 2.0), &[0, 2][..]));
    // The place among a photograph's points, and the pixel with its centre at halves.
    assert!(text[2].1.contains("\n1 0.250000 -1.500000 2.000000 1 2 3 0 3 0 1 0\n"), "{}", text[2].1);
    let observed: Vec<_> = text[1].1.lines().skip(2).step_by(2).collect();
    assert_eq!(observed, ["31.5 20.5 1", "", "5.5 7.5 1"]);
}

#[test]
fn a_map_has_its_sizes_and_then_its_rows() {
    let bytes = colmap_map(Array3::from_shape_fn((2, 3, 4), |(c, y, x)| (c * 12 + y * 4 + x) as f32).view());
    let values = bytes.strip_prefix(b"4&3&2&").unwrap().chunks_exact(4);
    let values: Vec<f32> = values.map(|value| f32::from_le_bytes(value.try_into().unwrap())).collect();
    assert_eq!(values, (0..24_u8).map(f32::from).collect::<Vec<_>>());
}

#[test]
fn a_photograph_s_sparse_depths_are_those_of_its_points() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("cameras.txt", "7 PINHOLE 64 48 50 50 32 24\n");
    // A metre before the world's origin; the second image is of the same name in another folder.
    let images = "1 1 0 0 0 0 0 1 7 left/a.jpg\n\n2 1 0 0 0 1 0 1 7 left/b.jpg\n\n";
    write("images.txt", images);
    write(
        "points3D.txt",
        "1 0.2 -0.1 1 0 0 0 0.5 1 0 2 0\n2 0 0 -3 0 0 0 0.5 1 1 2 1\n3 0 0 2 0 0 0 0.5 2 2\n4 9 0 2 0 0 0 0.5 1 3\n",
    );
    let found = read_colmap_depths(folder.path(), "a.jpg").unwrap();
    assert_eq!(found, ((48, 64), vec![KnownDepth { x: 36.5, y: 21.0, depth: 2.0, sigma: 0.0 }]));
    let gone = read_colmap_depths(folder.path(), "c.jpg").unwrap_err().to_string();
    assert!(gone.contains("c.jpg") && gone.contains("0 photographs"), "{gone}");
    write("images.txt", &images.replace("left/b.jpg", "right/a.jpg"));
    assert!(read_colmap_depths(folder.path(), "a.jpg").unwrap_err().to_string().contains("2 photographs"));
    assert_eq!(read_colmap_depths(folder.path(), "left/a.jpg").unwrap(), found);
}

#[test]
fn bad_models_are_named() {
    let (text, bytes) = colmap_files(&frames());
    let damaged = |damage: fn(&mut [Vec<u8>; 3])| {
        let mut bytes = bytes.clone();
        damage(&mut bytes);
        from_bytes(&bytes).map(drop)
    };
    let [models, images, points] = text;
    let other = from_text(&[models, images.replace(" 7 ", " 8 "), points]).map(drop);
    for (found, named) in [
        (damaged(|files| files[1].truncate(100)), "byte"),
        (damaged(|files| files[2][..8].fill(u8::MAX)), "do not fit"),
        (damaged(|files| files[0][12] = 5), "OPENCV_FISHEYE"),
        (other, "camera 8"),
    ] {
        let message = found.unwrap_err().to_string();
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn a_trajectory_is_joined_to_its_photographs() {
    let lens = frames()[0].lens;
    let read = |rgb: &str, truth: &str| {
        tum::parse(Path::new("shots/rgb.txt"), rgb, Path::new("truth.txt"), truth, &lens, &present)
    };
    let rgb = "# time file\n1.000 rgb/a.png\n1.100 rgb/b.png\n9.0 rgb/late.png\n";
    let truth = "1.105 1 2 3 0 0 0 1\n0.995 0 0 0 0 0 0.70710678 0.70710678\n";
    let capture = read(rgb, truth).unwrap();
    assert_eq!(capture.frames.len(), 2);
    assert_eq!(capture.frames[1].photograph, Path::new("shots/rgb/b.png"));
    let centre = capture.frames[1].pose.inverse().translation.vector;
    assert!((centre - Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    // A camera turned by a quarter about z carries its x axis to the world's y.
    let world = capture.frames[0].pose.inverse() * Point3::new(1.0, 0.0, 0.0);
    assert!((world - Point3::new(0.0, 1.0, 0.0)).norm() < 1e-6);
    let zero = read(rgb, "1.0 0 0 0 0 0 0 0\n1.1 1 1 1 0 0 0 1").unwrap_err().to_string();
    assert!(zero.contains("rgb/a.png: its quaternion is not of unit length"), "{zero}");
    let short = read(rgb, "1.0 0 0 0 0 0 0\n").unwrap_err().to_string();
    assert!(short.contains("line 1: qw is missing"), "{short}");
    assert!(read(rgb, "").unwrap_err().to_string().contains("at least 2"));
}

proptest! {
    /// No bytes make a reader panic or take memory that the file cannot fill.
    #[test]
    fn no_bytes_bring_a_reader_down(bytes in prop::collection::vec(any::<u8>(), 0..400), at in 0..400_usize, with: u8) {
        let path = Path::new("x");
        let _ = colmap::binary_cameras(path, &bytes);
        let _ = colmap::binary_images(path, &bytes);
        let _ = colmap::binary_points(path, &bytes);
        // The same for a good file with one byte changed.
        let (text, mut good) = colmap_files(&frames());
        for file in &mut good {
            if let Some(byte) = file.get_mut(at) {
                *byte = with;
            }
        }
        let _ = from_bytes(&good);
        let damaged = |text: &str| {
            let mut bytes = text.as_bytes().to_vec();
            if let Some(byte) = bytes.get_mut(at) {
                *byte = with;
            }
            String::from_utf8_lossy(&bytes).into_owned()
        };
        let _ = from_text(&text.map(|t| damaged(&t)));
        let _ = transforms(&damaged(&written(&frames())));
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let lens = frames()[0].lens;
        let _ = tum::parse(path, &text, path, &text, &lens, &present);
    }

    /// A photograph taken through a lens shows, once undistorted, each ray where the pinhole camera has it.
    #[test]
    fn distortion_is_undone(k1 in -0.3..0.3_f64, k2 in -0.05..0.05_f64, p1 in -0.01..0.01_f64, p2 in -0.01..0.01_f64) {
        let camera = PinholeCamera::from_fov(60.0, 40, 30).unwrap();
        let lens = Lens { camera, distortion: Distortion { k1, k2, k3: 0.0, p1, p2 } };
        // Colours are the photograph's own coordinates.
        let photograph = Array3::from_shape_fn((30, 40, 3), |(y, x, c)| [x as f32, y as f32, 0.0][c] / 40.0);
        let (image, mask) = lens.undistort(photograph.view()).unwrap();
        for ((y, x), &known) in mask.indexed_iter() {
            let Some(at) = lens.photograph_pixel(Point2::new(x as f64, y as f64)) else {
                prop_assert!(!known);
                continue;
            };
            let inside = (0.0..=39.0).contains(&at.x) && (0.0..=29.0).contains(&at.y);
            prop_assert!(known || !inside);
            if inside {
                let (u, v) = (f64::from(40.0 * image[(y, x, 0)]), f64::from(40.0 * image[(y, x, 1)]));
                prop_assert!((u - at.x).abs() < 1e-3 && (v - at.y).abs() < 1e-3);
            }
        }
    }
}

#[test]
fn a_photograph_of_another_size_is_named() {
    let frame = &frames()[0];
    let error = frame.view(Array3::zeros((10, 12, 3)).view()).unwrap_err().to_string();
    assert!(error.contains("12x10 pixels but its camera 64x48"), "{error}");
    assert!(frame.view(Array3::zeros((48, 64, 3)).view()).is_ok());
}
