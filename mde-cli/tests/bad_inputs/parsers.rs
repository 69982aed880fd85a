//! Captures whose files have one fault each: `transforms.json`, COLMAP's text and binary, TUM's trajectories.

use crate::common::{HEIGHT, Place, WIDTH};
use crate::table::{Case, check, refused};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// The words of the remedy or of the expected value, beside the file's name.
type Told = &'static [&'static str];

fn refine(views: &Path) -> String {
    format!("refine shots/a.png --prior-depth depth.npy --views {}", views.display())
}

/// Photographs `shots/a.png` and two more in a folder.
fn shots(folder: &Path, photographs: &str) {
    let photographs = folder.join(photographs);
    fs::create_dir_all(&photographs).unwrap();
    let place = Place::new();
    for name in ["a.png", "b.png", "c.png"] {
        fs::copy(place.path("image.png"), photographs.join(name)).unwrap();
    }
}

/// A field of the file, what is put there (nothing: the field is removed), and what the message must contain.
const TRANSFORMS: &[(&str, &str, Told)] = &[
    ("", "[]", &["not an object"]),
    ("", "null", &["not an object"]),
    ("", "\"frames\"", &["not an object"]),
    ("/frames", "", &["frames", "missing"]),
    ("/frames", "{}", &["frames", "missing"]),
    ("/frames/0", "7", &["frames[0]", "not an object"]),
    ("/frames/2", "[]", &["frames[2]", "not an object"]),
    ("/frames/0/file_path", "", &["frames[0]", "file_path is missing"]),
    ("/frames/0/file_path", "5", &["frames[0]", "file_path is missing"]),
    ("/frames/1/file_path", "\"\"", &["is missing; copy it there"]),
    ("/frames/1/file_path", "\"shots\"", &["shots", "is missing; copy it there"]),
    ("/frames/1/file_path", "\"shots/b\\u001b[2Jred.png\"", &["is missing; copy it there"]),
    ("/frames/1/file_path", "\"shots/b\\nline.png\"", &["is missing; copy it there"]),
    ("/frames/1/file_path", "\"/etc/passwd\"", &["/etc/passwd", "is missing; copy it there"]),
    ("/frames/1/transform_matrix", "", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix", "[]", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix", "\"identity\"", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix/0", "[1, 0, 0]", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix/2", "3", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix/0/3", "null", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix/0/3", "true", &["frames[1]", "4x4"]),
    ("/frames/1/transform_matrix/0/3", "1e13", &["shots/b.png", "1e12"]),
    ("/frames/1/transform_matrix/0/3", "1e999", &["JSON", "out of range"]),
    ("/frames/1/transform_matrix/0/3", "NaN", &["JSON"]),
    ("/frames/1/transform_matrix/0/0", "2.0", &["shots/b.png", "scaled"]),
    ("/frames/1/transform_matrix/1/1", "0.5", &["shots/b.png", "orthonormal"]),
    ("/frames/1/transform_matrix/1/0", "0.5", &["shots/b.png", "orthonormal"]),
    ("/fl_x", "", &["frames[0]", "give fl_x or camera_angle_x"]),
    ("/fl_x", "-60", &["frames[0]", "fx is -60"]),
    ("/fl_x", "\"60\"", &["frames[0].fl_x", "finite number"]),
    ("/fl_x", "null", &["frames[0].fl_x", "finite number"]),
    ("/fl_x", "[60]", &["frames[0].fl_x", "finite number"]),
    ("/fl_y", "0", &["frames[0]", "fy is 0"]),
    ("/frames/1/fl_x", "-1", &["frames[1]", "fx is -1"]),
    ("/cx", "\"middle\"", &["frames[0].cx", "finite number"]),
    ("/cy", "{}", &["frames[0].cy", "finite number"]),
    ("/w", "0", &["frames[0].w", "1 to 65536"]),
    ("/w", "64.5", &["frames[0].w", "1 to 65536"]),
    ("/w", "-64", &["frames[0].w", "1 to 65536"]),
    ("/h", "1e9", &["frames[0].h", "1 to 65536"]),
    ("/h", "47", &["64x48", "64x47"]),
    ("/frames/2/w", "128", &["c.png", "64x48", "128x48"]),
    ("/k1", "\"a\"", &["frames[0].k1", "finite number"]),
    ("/p2", "false", &["frames[0].p2", "finite number"]),
    ("/k4", "0.1", &["k4", "undistort"]),
    ("/is_fisheye", "true", &["is_fisheye", "undistort"]),
    ("/camera_model", "\"FOV\"", &["FOV", "undistort"]),
    ("/camera_model", "7", &["undistort"]),
    ("/pixel_centres", "\"corners\"", &["pixel_centres", "halves"]),
    ("/pixel_centres", "1", &["pixel_centres", "halves"]),
];

fn whole() -> Value {
    let frame = |name: &str, x: f64| {
        json!({ "file_path": name, "transform_matrix":
            [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]] })
    };
    json!({ "fl_x": 60.0, "fl_y": 60.0, "cx": 31.5, "cy": 23.5, "w": WIDTH, "h": HEIGHT,
        "frames": [frame("shots/a.png", 0.0), frame("shots/b.png", 0.1), frame("shots/c.png", 0.2)] })
}

/// The text of the capture with one field changed.
fn changed(field: &str, to: &str) -> String {
    const MARK: &str = "the changed value";
    let mut value = whole();
    let (parent, key) = field.rsplit_once('/').unwrap_or_default();
    match value.pointer_mut(parent) {
        Some(Value::Object(fields)) if !key.is_empty() => {
            if to.is_empty() {
                fields.remove(key);
            } else {
                fields.insert(key.to_owned(), json!(MARK));
            }
        }
        Some(Value::Array(entries)) => entries[key.parse::<usize>().unwrap()] = json!(MARK),
        // The whole text.
        _ => return to.to_owned(),
    }
    value.to_string().replace(&format!("\"{MARK}\""), to)
}

#[test]
pub(crate) fn unusable_transforms() {
    let place = Place::new();
    shots(&place.path("."), "shots");
    let cases: Vec<Case> = TRANSFORMS
        .iter()
        .enumerate()
        .map(|(index, (field, to, told))| {
            let name = format!("transforms-{index}.json");
            place.write(&name, changed(field, to));
            let told: Vec<_> = told.iter().copied().chain(["transforms-"]).collect();
            refused(
                refine(&place.path(&name))
                    .replace("shots/a.png", &format!("{}", place.path("shots/a.png").display())),
                &told,
            )
        })
        .collect();
    check(&cases);
}

const CAMERAS: &str = "# cameras\n1 PINHOLE 64 48 60 60 32 24\n";
const IMAGES: &str =
    "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0.1 0 0 1 b.png\n3 4 -1 1 0 0\n3 1 0 0 0 0.2 0 0 1 c.png\n\n";
const POINTS: &str = "1 0 0 2 9 9 9 0.5 1 0 2 0\n";

/// A file of COLMAP's text, what it contains, and what the message must contain.
const COLMAP_TEXT: &[(&str, &str, Told)] = &[
    ("cameras.txt", "", &["images.txt", "camera 1", "not among"]),
    ("cameras.txt", "1\n", &["cameras.txt", "undistort"]),
    ("cameras.txt", "one PINHOLE 64 48 60 60 32 24\n", &["line 1", "number", "integer"]),
    ("cameras.txt", "1 PINHOLE 64 48 60 60 32\n", &["line 1", "parameter 4 of PINHOLE", "missing"]),
    ("cameras.txt", "1 PINHOLE 64 48 60 60 32 x\n", &["line 1", "finite number"]),
    ("cameras.txt", "1 PINHOLE 64 48 nan 60 32 24\n", &["line 1", "finite number"]),
    ("cameras.txt", "1 PINHOLE 64 48 -60 60 32 24\n", &["line 1", "fx is -60"]),
    ("cameras.txt", "1 PINHOLE 64 48 0 60 32 24\n", &["line 1", "fx is 0"]),
    ("cameras.txt", "1 PINHOLE 0 48 60 60 32 24\n", &["line 1", "width is 0"]),
    ("cameras.txt", "1 PINHOLE 64 -48 60 60 32 24\n", &["line 1", "height", "integer"]),
    ("cameras.txt", "1 PINHOLE 64 99999 60 60 32 24\n", &["line 1", "65536"]),
    ("cameras.txt", "1 PINHOLE 65 48 60 60 32 24\n", &["a.png", "64x48", "65x48"]),
    ("cameras.txt", "1 OPENCV_FISHEYE 64 48 60 60 32 24 0 0 0 0\n", &["OPENCV_FISHEYE", "undistort"]),
    ("cameras.txt", "1 pinhole 64 48 60 60 32 24\n", &["pinhole", "PINHOLE"]),
    ("images.txt", "", &["images.txt", "at least 2"]),
    ("images.txt", "# nothing\n", &["images.txt", "at least 2"]),
    ("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n", &["images.txt", "at least 2"]),
    ("images.txt", "1 1 0 0 0 0 0 0 1\n", &["line 1", "name is missing"]),
    ("images.txt", "1 1 0 0 0 0 0\n", &["line 1", "missing"]),
    ("images.txt", "1 1 0 0 zero 0 0 0 1 a.png\n", &["line 1", "qz is zero", "finite number"]),
    ("images.txt", "1 0 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["a.png", "unit length"]),
    ("images.txt", "1 2 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["a.png", "unit length"]),
    ("images.txt", "1 1e308 1e308 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["a.png", "finite"]),
    ("images.txt", "1 1 0 0 0 1e30 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["a.png", "1e12"]),
    ("images.txt", "1 1 0 0 0 0 0 0 7 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["a.png", "camera 7"]),
    ("images.txt", "1 1 0 0 0 0 0 0 1 z.png\n\n2 1 0 0 0 1 0 0 1 b.png\n", &["z.png", "is missing; copy it"]),
    ("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0 0 0 1 b.png\n", &["from one place", "add some"]),
    (
        "images.txt",
        "1 1 0 0 0 0 0 0 1 b.png\n\n2 1 0 0 0 1 0 0 1 c.png\n",
        &["a.png", "not a photograph of this capture"],
    ),
    ("images.txt", "-1 1 0 0 0 0 0 0 1 a.png\n", &["line 1", "integer"]),
    ("points3D.txt", "1 0 0\n", &["line 1", "z is missing"]),
    ("points3D.txt", "1 0 0 far 9 9 9 0.5 1 0\n", &["line 1", "z is far", "finite number"]),
    ("points3D.txt", "1 0 0 2 9 9 9\n", &["line 1", "error is missing"]),
    ("points3D.txt", "1 0 0 2 9 9 9 0.5 one 0\n", &["line 1", "track", "integer"]),
    ("points3D.txt", "1 0 0 2 9 9 9 0.5 -1 0\n", &["line 1", "track", "integer"]),
    ("points3D.txt", "1 0 inf 2 9 9 9 0.5 1 0\n", &["line 1", "y is inf", "finite number"]),
];

/// A folder with a COLMAP model beside its photographs.
fn colmap(place: &Place, name: &str) -> std::path::PathBuf {
    let folder = place.path(name);
    shots(&folder, "images");
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    folder
}

fn refine_image(folder: &Path) -> String {
    let folder = folder.display();
    format!("refine {folder}/images/a.png --prior-depth depth.npy --views {folder}")
}

#[test]
pub(crate) fn unusable_colmap_text() {
    let place = Place::new();
    let mut cases: Vec<Case> = COLMAP_TEXT
        .iter()
        .enumerate()
        .map(|(index, (file, text, told))| {
            let folder = colmap(&place, &format!("text-{index}"));
            for (name, good) in [("cameras.txt", CAMERAS), ("images.txt", IMAGES), ("points3D.txt", POINTS)] {
                let text = if name == *file { *text } else { good };
                fs::write(folder.join("sparse/0").join(name), text).unwrap();
            }
            refused(refine_image(&folder), told)
        })
        .collect();
    let alone = colmap(&place, "no-images");
    fs::write(alone.join("sparse/0/cameras.txt"), CAMERAS).unwrap();
    cases.push(refused(refine_image(&alone), &["images.txt"]));
    let latin = colmap(&place, "latin");
    fs::write(latin.join("sparse/0/cameras.txt"), CAMERAS).unwrap();
    fs::write(latin.join("sparse/0/images.txt"), b"1 1 0 0 0 0 0 0 1 caf\xe9.png\n").unwrap();
    cases.push(refused(refine_image(&latin), &["images.txt", "not UTF-8"]));
    check(&cases);
}

/// COLMAP's binary model of the same photographs: `cameras.bin`, `images.bin`, `points3D.bin`.
fn binary() -> [Vec<u8>; 3] {
    let integers = |values: &[u64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let floats = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let short = |value: u32| value.to_le_bytes().to_vec();
    let cameras =
        [integers(&[1]), short(1), short(1), integers(&[64, 48]), floats(&[60.0, 60.0, 32.0, 24.0])].concat();
    let mut images = integers(&[3]);
    for (index, name) in ["a.png", "b.png", "c.png"].into_iter().enumerate() {
        images.extend(short(index as u32 + 1));
        images.extend(floats(&[1.0, 0.0, 0.0, 0.0, 0.1 * index as f64, 0.0, 0.0]));
        images.extend([&short(1)[..], name.as_bytes(), &[0], &integers(&[0])].concat());
    }
    let points = [
        integers(&[1, 1]),
        floats(&[0.0, 0.0, 2.0]),
        vec![9, 9, 9],
        floats(&[0.5]),
        integers(&[1]),
        short(1),
        short(0),
    ];
    [cameras, images, points.concat()]
}

#[test]
pub(crate) fn unusable_colmap_binaries() {
    const FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];
    let not_finite = f64::NAN.to_le_bytes();
    let huge = u64::MAX.to_le_bytes();
    let put = |file: usize, at: usize, bytes: &[u8]| {
        let mut good = binary()[file].clone();
        good[at..at + bytes.len()].copy_from_slice(bytes);
        (file, good)
    };
    let cut = |file: usize, length: usize| (file, binary()[file][..length].to_vec());
    // A camera: number of cameras (8 bytes), id, model (4 each), width, height (8 each), parameters. An image: number of
    // images, id (4), quaternion, translation (8 each), camera (4), name, number of points (8).
    let cases: Vec<((usize, Vec<u8>), Told)> = vec![
        (cut(0, 0), &["cameras.bin", "byte 0", "export the model again"]),
        (cut(0, 7), &["cameras.bin", "byte 0", "export the model again"]),
        (cut(0, 30), &["cameras.bin", "do not fit in the file"]),
        (cut(0, 63), &["cameras.bin", "byte", "too early"]),
        (put(0, 0, &huge), &["cameras.bin", "do not fit in the file"]),
        (put(0, 0, &0_u64.to_le_bytes()), &["images.bin", "camera 1", "not among"]),
        (put(0, 12, &5_u32.to_le_bytes()), &["OPENCV_FISHEYE", "undistort"]),
        (put(0, 12, &99_u32.to_le_bytes()), &["camera model 99", "undistort"]),
        (put(0, 16, &huge), &["cameras.bin", "65536"]),
        (put(0, 16, &0_u64.to_le_bytes()), &["cameras.bin", "width is 0"]),
        (put(0, 32, &not_finite), &["cameras.bin", "not finite"]),
        (put(0, 32, &(-60.0_f64).to_le_bytes()), &["cameras.bin", "fx is -60"]),
        (cut(1, 0), &["images.bin", "byte 0", "export the model again"]),
        (cut(1, 60), &["images.bin", "do not fit in the file"]),
        (cut(1, 239), &["images.bin"]),
        (put(1, 0, &huge), &["images.bin", "do not fit in the file"]),
        (put(1, 0, &0_u64.to_le_bytes()), &["images.bin", "at least 2"]),
        (put(1, 12, &not_finite), &["a.png", "not finite"]),
        (put(1, 12, &0.5_f64.to_le_bytes()), &["a.png", "unit length"]),
        (put(1, 44, &1e300_f64.to_le_bytes()), &["a.png", "1e12"]),
        (put(1, 68, &9_u32.to_le_bytes()), &["a.png", "camera 9"]),
        (put(1, 72, &[0xff]), &["images.bin", "not UTF-8"]),
        (put(1, 78, &huge), &["images.bin", "do not fit in the file"]),
        (put(1, 72, b"z"), &["z.png", "is missing; copy it"]),
        (cut(2, 20), &["points3D.bin"]),
        (put(2, 0, &huge), &["points3D.bin", "do not fit in the file"]),
        (put(2, 51, &huge), &["points3D.bin", "do not fit in the file"]),
    ];
    let place = Place::new();
    let cases: Vec<Case> = cases
        .into_iter()
        .enumerate()
        .map(|(index, ((changed, bytes), told))| {
            let folder = colmap(&place, &format!("binary-{index}"));
            for ((at, name), good) in FILES.into_iter().enumerate().zip(binary()) {
                let bytes = if at == changed { &bytes } else { &good };
                fs::write(folder.join("sparse/0").join(name), bytes).unwrap();
            }
            refused(refine_image(&folder), told)
        })
        .collect();
    check(&cases);
}

const RGB: &str = "# time name\n1.00 a.png\n1.03 b.png\n1.06 c.png\n";
const TRUTH: &str = "1.00 0 0 0 0 0 0 1\n1.03 0.1 0 0 0 0 0 1\n1.06 0.2 0 0 0 0 0 1\n";

const TUM: &[(&str, &str, Told)] = &[
    ("rgb.txt", "", &["rgb.txt", "at least 2"]),
    ("rgb.txt", "1.00 a.png\n", &["rgb.txt", "at least 2"]),
    ("rgb.txt", "1.00\n", &["rgb.txt", "line 1", "name is missing"]),
    ("rgb.txt", "noon a.png\n", &["rgb.txt", "line 1", "time is noon", "finite number"]),
    ("rgb.txt", "nan a.png\n", &["rgb.txt", "line 1", "time is nan", "finite number"]),
    ("rgb.txt", "1.00 a.png\n1.03 z.png\n", &["z.png", "is missing; copy it"]),
    ("rgb.txt", "7.00 a.png\n8.03 b.png\n", &["rgb.txt", "at least 2"]),
    ("rgb.txt", "1.03 b.png\n1.06 c.png\n", &["a.png", "not a photograph of this capture"]),
    ("groundtruth.txt", "", &["rgb.txt", "at least 2"]),
    ("groundtruth.txt", "1.00 0 0 0 0 0 0\n", &["groundtruth.txt", "line 1", "qw is missing"]),
    ("groundtruth.txt", "1.00 0 0 0 0 0 0 up\n", &["groundtruth.txt", "line 1", "qw is up"]),
    ("groundtruth.txt", "1.00 0 0 inf 0 0 0 1\n", &["groundtruth.txt", "line 1", "tz is inf"]),
    ("groundtruth.txt", "1.00 0 0 0 0 0 0 0\n1.03 1 0 0 0 0 0 1\n", &["a.png", "unit length"]),
    ("groundtruth.txt", "1.00 0 0 1e20 0 0 0 1\n1.03 1 0 0 0 0 0 1\n", &["a.png", "1e12"]),
    ("groundtruth.txt", "1.00 0 0 0 0 0 0 1\n1.03 0 0 0 0 0 0 1\n", &["from one place", "add some"]),
];

#[test]
pub(crate) fn unusable_trajectories() {
    let place = Place::new();
    let cases: Vec<Case> = TUM
        .iter()
        .enumerate()
        .map(|(index, (file, text, told))| {
            let folder = place.path(&format!("tum-{index}"));
            shots(&folder, "");
            for (name, good) in [("rgb.txt", RGB), ("groundtruth.txt", TRUTH)] {
                fs::write(folder.join(name), if name == *file { *text } else { good }).unwrap();
            }
            let folder = folder.display();
            refused(format!("refine {folder}/a.png --prior-depth depth.npy --fov 60 --views {folder}"), told)
        })
        .collect();
    check(&cases);
}
