//! The files that the cases name.

use crate::common::{HEIGHT, Place, WIDTH, fixture};
use image::{DynamicImage, ImageFormat};
use mde_cli::mde_prior::format::{write_depth, write_npy, write_npz, write_png16};
use mde_cli::mde_prior::photo::write_image;
use ndarray::{Array2, Array3};
use serde_json::json;
use std::fs;

const QUICK: &str = "\
views.count = 2
nerf.field = { levels = 4, log2-rows = 10, finest = 64, width = 16 }
nerf.train = { steps = 20, rays = 64 }
nerf.sampling = { coarse = 4, band = 4, fine = 4 }
nerf.render = { coarse = 4, fine = 4 }
";

pub(crate) fn place() -> Place {
    let place = Place::new();
    for (name, text) in [
        ("quick.toml", QUICK),
        ("broken.toml", "seed = = 1\n"),
        ("many.toml", "refinement.order = 'paper'\nviews.count = 1000000\n"),
        (
            "grid.toml",
            "refinement.order = 'paper'\nnerf.field = { log2-rows = 24, levels = 24, features = 8 }\n",
        ),
        (
            "rays.toml",
            "refinement.order = 'paper'\nnerf.train.rays = 65536\nnerf.sampling = { coarse = 1024, band = 0, fine = 1024 }\n",
        ),
        ("three.toml", "multi-view.max-views = 3\n"),
        ("known.csv", "x,y,depth\n3,4,2.5\n30,20,3.5\n"),
        ("known-one.csv", "3,4,2.5\n"),
        ("good.txt", "60 0 32.5\n0 60 24.5\n0 0 1\n"),
        ("sized.json", r#"{"fx": 60, "fy": 60, "cx": 32, "cy": 24, "width": 64, "height": 48}"#),
        ("list.txt", "image.png\n"),
        ("fastdepth.onnx", "this is no model"),
        ("mystery.onnx", "this is no model"),
        ("empty.onnx", ""),
        ("empty.txt", ""),
        ("file", ""),
        ("thesis/chapter.txt", "years"),
        ("earlier/run.json", "{}"),
        ("notes/notes.txt", "none"),
        ("shots/torn.jpg", "no photograph"),
        ("rows/net.toml", "width = 32\nheight = 24\noutput = 'metric'\n"),
        ("rows/grey.toml", "width = 48\nheight = 32\noutput = 'metric'\n"),
        ("rows/hub/config.json", r#"{"model_type": "zoedepth"}"#),
        ("calibration.toml", include_str!("../../src/refiner/calibration/default.toml")),
    ] {
        place.write(name, text);
    }
    for folder in ["folder.png", "folder.npy", "empty"] {
        fs::create_dir(place.path(folder)).unwrap();
    }
    let net = fixture("grey_nchw.onnx");
    for entry in fs::read_dir(net.parent().unwrap()).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|extension| extension == "onnx") {
            place.write(
                &format!("nets/{}", entry.file_name().unwrap().to_str().unwrap()),
                fs::read(&entry).unwrap(),
            );
        }
    }
    for name in ["net", "zoedepth", "hub/model", "dpt_large"] {
        place.take("nets/rows.onnx", &format!("rows/{name}.onnx"));
    }
    place.take("nets/grey_nchw.onnx", "rows/grey.onnx");
    pictures(&place);
    maps(&place);
    data_sets(&place);
    captures(&place);
    let fit = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --export field -q -o fit";
    place.mde(fit).assert().success();
    fs::rename(place.path("fit/field.safetensors"), place.path("field.safetensors")).unwrap();
    place
}

fn pictures(place: &Place) {
    let image = Array3::from_shape_fn((HEIGHT, WIDTH, 3), |(y, x, c)| {
        ((x * (c + 1)) as f32 / 9.0).sin() * 0.3 + y as f32 / 200.0 + 0.4
    });
    write_image(place.path("picture.png"), image.view()).unwrap();
    for (name, height, width, value) in [
        ("dot.png", 1, 1, 0.5),
        ("row.png", 1, WIDTH, 0.5),
        ("column.png", HEIGHT, 1, 0.5),
        ("thin.png", HEIGHT, 7, 0.5),
        ("smallest.png", 8, 8, 0.5),
        ("long.png", 8, 200, 0.5),
        ("black.png", HEIGHT, WIDTH, 0.0),
        ("big.png", 480, 640, 0.4),
    ] {
        write_image(place.path(name), Array3::from_elem((height, width, 3), value).view()).unwrap();
    }
    let picture = image::open(place.path("picture.png")).unwrap();
    let mut broken = picture.to_rgb32f();
    broken.put_pixel(3, 4, image::Rgb([f32::NAN, 0.0, 0.0]));
    let png = ImageFormat::Png;
    let pictures: [(&str, DynamicImage, ImageFormat); 13] = [
        ("grey.png", picture.to_luma8().into(), png),
        ("grey16.png", picture.to_luma16().into(), png),
        ("grey-alpha.png", picture.to_luma_alpha8().into(), png),
        ("alpha.png", picture.to_rgba8().into(), png),
        ("rgb16.png", picture.to_rgb16().into(), png),
        ("rgba16.png", picture.to_rgba16().into(), png),
        ("grey.jpg", picture.to_luma8().into(), ImageFormat::Jpeg),
        ("plain.jpg", picture.to_rgb8().into(), ImageFormat::Jpeg),
        ("plain.webp", picture.clone(), ImageFormat::WebP),
        ("plain.bmp", picture.clone(), ImageFormat::Bmp),
        ("plain.tif", picture.clone(), ImageFormat::Tiff),
        ("floats.tif", picture.to_rgb32f().into(), ImageFormat::Tiff),
        ("nan.tif", broken.into(), ImageFormat::Tiff),
    ];
    for (name, picture, format) in pictures {
        picture.save_with_format(place.path(name), format).unwrap();
    }
    for name in ["no-extension", "wrong.jpg"] {
        fs::copy(place.path("picture.png"), place.path(name)).unwrap();
    }
    let own = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    for entry in fs::read_dir(own).unwrap().map(Result::unwrap) {
        fs::copy(entry.path(), place.path(entry.file_name().to_str().unwrap())).unwrap();
    }
    let mut two_frames = fs::read(place.path("plain.jpg")).unwrap();
    // Behind the scan: progressive, 65500x65500, 255 components.
    let end = two_frames.len() - 2;
    let mut frame = vec![0xff, 0xc2, 0x03, 0x05, 8, 0xff, 0xdc, 0xff, 0xdc, 255];
    frame.extend((0..255).flat_map(|id| [id, 0x11, 0]));
    two_frames.splice(end..end, frame);
    place.write("two-frames.jpg", two_frames);
}

/// An NPY file of any header.
pub(crate) fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{header}\n");
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

fn header(kind: &str) -> String {
    format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (48, 64), }}")
}

fn pixels() -> impl Iterator<Item = f64> {
    (0..HEIGHT * WIDTH).map(|i| 2.0 + (i % WIDTH + 2 * (i / WIDTH)) as f64 * 0.01)
}

/// The values of a map of 32-bit floats.
pub(crate) fn values() -> Vec<u8> {
    pixels().flat_map(|v| (v as f32).to_le_bytes()).collect()
}

fn maps(place: &Place) {
    let depth = place.scene.depth.clone();
    // Any values: the writer of maps refuses NaN.
    let of = |name: &str, value: &dyn Fn(usize, usize) -> f32| {
        let values = (0..HEIGHT * WIDTH).flat_map(|i| value(i / WIDTH, i % WIDTH).to_le_bytes());
        place.write(name, npy(&header("<f4"), &values.collect::<Vec<_>>()));
    };
    for (name, value) in [
        ("zero.npy", 0.0),
        ("negative.npy", -2.0),
        ("constant.npy", 2.0),
        ("infinite.npy", f32::INFINITY),
        ("nan.npy", f32::NAN),
        ("denormal.npy", 1e-42),
        ("largest.npy", f32::MAX),
        ("large.npy", 1e9),
        ("tiny.npy", 1e-9),
    ] {
        of(name, &|_, _| value);
    }
    of("one-pixel.npy", &|y, x| if (y, x) == (20, 30) { 2.0 } else { 0.0 });
    of("holes.npy", &|y, x| if (x + y) % 3 == 0 { 0.0 } else { depth[(y, x)] });
    of("half-missing.npy", &|y, x| if x < WIDTH / 2 { 0.0 } else { depth[(y, x)] });
    of("extremes.npy", &|y, x| if (x / 8 + y / 8) % 2 == 0 { 1e-3 } else { 1e3 });
    of("some-nan.npy", &|y, x| if y < 2 { f32::NAN } else { depth[(y, x)] });
    of("mixed.npy", &|y, x| {
        [f32::INFINITY, -1.0, f32::NEG_INFINITY].get((x + 2 * y) % 7).copied().unwrap_or(depth[(y, x)])
    });
    of("disparity.npy", &|y, x| 3.0 / depth[(y, x)] - 2.0);
    for (name, height, width) in [
        ("small.npy", HEIGHT / 2, WIDTH / 2),
        ("turned.npy", WIDTH, HEIGHT),
        ("dot.npy", 1, 1),
        ("smallest.npy", 8, 8),
        ("long.npy", 8, 200),
        ("half-size.npy", 24, 32),
        ("big.npy", 480, 640),
    ] {
        let map = Array2::from_shape_fn((height, width), |(y, x)| 1.0 + (x + y) as f32 * 0.01);
        write_npy(place.path(name), map.view()).unwrap();
    }
    for name in ["depth.pfm", "depth.exr", "depth.npz"] {
        write_depth(place.path(name), depth.view()).unwrap();
    }
    write_png16(place.path("depth.png"), depth.view(), 5000.0).unwrap();
    write_npz(place.path("two.npz"), &[("near", depth.view()), ("far", depth.view())]).unwrap();
    write_npz(place.path("three.npz"), &[("near", depth.view()), ("depth", depth.view())]).unwrap();
    let mut big_endian = b"Pf\n64 48\n1.0\n".to_vec();
    big_endian.extend(pixels().flat_map(|v| (v as f32).to_be_bytes()));
    place.write("big-endian.pfm", big_endian);
    for (name, kind, data) in [
        ("f4.npy", "<f4", values()),
        ("f8.npy", "<f8", pixels().flat_map(f64::to_le_bytes).collect()),
        ("f4be.npy", ">f4", pixels().flat_map(|v| (v as f32).to_be_bytes()).collect()),
        ("u2.npy", "<u2", pixels().flat_map(|v| ((1000.0 * v) as u16).to_le_bytes()).collect()),
        ("u1.npy", "|u1", pixels().map(|v| (10.0 * v) as u8).collect()),
        ("bool.npy", "|b1", vec![1; HEIGHT * WIDTH]),
    ] {
        place.write(name, npy(&header(kind), &data));
    }
}

fn data_sets(place: &Place) {
    for (from, to) in [
        ("image.png", "set/a/color.png"),
        ("depth.npy", "set/a/depth.npy"),
        ("depth.npy", "priors/a.npy"),
        ("depth.npy", "maps/a.npy"),
        ("big.npy", "big-maps/big.npy"),
        ("plain.jpg", "sun/s/image/a.jpg"),
        ("depth.png", "sun/s/depth/a.png"),
        ("image.png", "shots/a.png"),
        ("image.png", "shots/b.png"),
        ("image.png", "shots/c.png"),
        ("image.png", "alone/a.png"),
    ] {
        place.write(to, fs::read(place.path(from)).unwrap());
    }
    place.write("set/a/scene.json", r#"{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}"#);
    place.write("sun/s/intrinsics.txt", "60 0 32 0 60 24 0 0 1");
}

/// The same three photographs with poses in each of the forms.
fn captures(place: &Place) {
    let frame = |name: &str, x: f64| {
        json!({ "file_path": name, "transform_matrix":
            [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]] })
    };
    let whole = json!({ "fl_x": 60.0, "fl_y": 60.0, "cx": 31.5, "cy": 23.5, "w": WIDTH, "h": HEIGHT,
        "frames": [frame("shots/a.png", 0.0), frame("shots/b.png", 0.1), frame("shots/c.png", 0.2)] });
    place.write("capture.json", whole.to_string());
    for (name, index, photograph) in [("torn.json", 2, "shots/torn.jpg"), ("elsewhere.json", 0, "image.png")]
    {
        let mut other = whole.clone();
        other["frames"][index]["file_path"] = json!(photograph);
        place.write(name, other.to_string());
    }

    let camera = "# cameras\n1 PINHOLE 64 48 60 60 32 24\n";
    for (name, text) in [
        ("colmap/sparse/0/cameras.txt", camera),
        (
            "colmap/sparse/0/images.txt",
            "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 0.1 0 0 1 b.png\n3 4 -1 1 0 0\n3 1 0 0 0 0.2 0 0 1 c.png\n\n",
        ),
        ("colmap/sparse/0/points3D.txt", "1 0 0 2 9 9 9 0.5 1 0 2 0\n"),
        ("model/cameras.txt", camera),
        ("model/images.txt", "1 1 0 0 0 0 0 0 1 image.png\n\n"),
        ("model/points3D.txt", "1 0 0 2 9 9 9 0.5 1 0\n"),
        ("tum/rgb.txt", "# time name\n1.00 a.png\n1.03 b.png\n1.06 c.png\n"),
        ("tum/groundtruth.txt", "1.00 0 0 0 0 0 0 1\n1.03 0.1 0 0 0 0 0 1\n1.06 0.2 0 0 0 0 0 1\n"),
    ] {
        place.write(name, text);
    }
    let integers = |values: &[u64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let floats = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let short = |value: u32| value.to_le_bytes().to_vec();
    let size = [integers(&[64, 48]), floats(&[60.0, 60.0, 32.0, 24.0])].concat();
    place.write("colmap-bin/sparse/0/cameras.bin", [integers(&[1]), short(1), short(1), size].concat());
    let mut images = integers(&[3]);
    for (index, name) in ["a.png", "b.png", "c.png"].into_iter().enumerate() {
        images.extend(short(index as u32 + 1));
        images.extend(floats(&[1.0, 0.0, 0.0, 0.0, 0.1 * index as f64, 0.0, 0.0]));
        images.extend([&short(1)[..], name.as_bytes(), &[0], &integers(&[0])].concat());
    }
    place.write("colmap-bin/sparse/0/images.bin", images);
    let point = [
        integers(&[1, 1]),
        floats(&[0.0, 0.0, 2.0]),
        vec![9; 3],
        floats(&[0.5]),
        integers(&[1]),
        short(1),
        short(0),
    ];
    place.write("colmap-bin/sparse/0/points3D.bin", point.concat());
    for folder in ["colmap/images", "colmap-bin/images", "tum"] {
        for name in ["a.png", "b.png", "c.png"] {
            fs::create_dir_all(place.path(folder)).unwrap();
            fs::copy(place.path("image.png"), place.path(folder).join(name)).unwrap();
        }
    }
}
