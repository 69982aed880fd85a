//! The files that the cases name.

use crate::captures::captures;
use crate::common::{HEIGHT, Place, WIDTH};
use image::{DynamicImage, ImageFormat};
use mde_cli::mde_prior::format::{write_depth, write_npy, write_npz, write_pfm, write_png16};
use mde_cli::mde_prior::photo::write_image;
use ndarray::{Array2, Array3};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

const QUICK: &str = "\
[views]
count = 2
[nerf.field]
levels = 4
log2-rows = 10
finest = 64
width = 16
[nerf.train]
steps = 20
rays = 64
[nerf.sampling]
coarse = 4
band = 4
fine = 4
[nerf.render]
coarse = 4
fine = 4
";

/// All inputs of all tables, made once and written for each test.
pub(crate) fn place() -> Place {
    static MADE: LazyLock<BTreeMap<PathBuf, Option<Vec<u8>>>> = LazyLock::new(|| {
        let mut found = BTreeMap::new();
        collect(&made().path("."), Path::new(""), &mut found);
        found
    });
    let place = Place::empty();
    for (path, bytes) in MADE.iter() {
        let path = place.path(".").join(path);
        match bytes {
            Some(bytes) => fs::write(path, bytes).unwrap(),
            None => fs::create_dir(path).unwrap(),
        }
    }
    place
}

/// The files below a folder with their bytes, and the folders, each before what is in it.
fn collect(root: &Path, inside: &Path, found: &mut BTreeMap<PathBuf, Option<Vec<u8>>>) {
    for entry in fs::read_dir(root.join(inside)).unwrap() {
        let entry = entry.unwrap();
        let path = inside.join(entry.file_name());
        assert!(!entry.file_type().unwrap().is_symlink(), "{}", path.display());
        if entry.path().is_dir() {
            found.insert(path.clone(), None);
            collect(root, &path, found);
        } else {
            found.insert(path, Some(fs::read(entry.path()).unwrap()));
        }
    }
}

fn made() -> Place {
    let place = Place::new();
    place.write("quick.toml", QUICK);
    for (name, text) in [
        ("known.csv", "x,y,depth\n3,4,2.5\n30,20,3.5\n"),
        ("known-none.csv", ""),
        ("known-head.csv", "x,y,depth\n"),
        ("known-two.csv", "3,4\n"),
        ("known-five.csv", "3,4,2.5,0.1,7\n"),
        ("known-word.csv", "3,4,2.5\n3,four,2.5\n"),
        ("known-zero.csv", "3,4,0\n"),
        ("known-minus.csv", "3,4,-2.5\n"),
        ("known-nan.csv", "3,4,nan\n"),
        ("known-sigma.csv", "3,4,2.5,-1\n"),
        ("known-outside.csv", "300,4,2.5\n3,-40,2.5\n"),
        ("known-one.csv", "3,4,2.5\n"),
    ] {
        place.write(name, text);
    }
    place.write("known-bytes.csv", [0xff, 0xfe, b',', b'1']);
    pictures(&place);
    maps(&place);
    arrays(&place);
    texts(&place);
    data_sets(&place);
    captures(&place);
    place
}

fn pictures(place: &Place) {
    let image = Array3::from_shape_fn((HEIGHT, WIDTH, 3), |(y, x, c)| {
        ((x * (c + 1)) as f32 / 9.0).sin() * 0.3 + y as f32 / 200.0 + 0.4
    });
    for (name, shape) in [
        ("dot.png", (1, 1, 3)),
        ("row.png", (1, WIDTH, 3)),
        ("column.png", (HEIGHT, 1, 3)),
        ("thin.png", (HEIGHT, 7, 3)),
        ("smallest.png", (8, 8, 3)),
        ("long.png", (8, 200, 3)),
        ("black.png", (HEIGHT, WIDTH, 3)),
    ] {
        let value = if name == "black.png" { 0.0 } else { 0.5 };
        write_image(place.path(name), Array3::from_elem(shape, value).view()).unwrap();
    }
    write_image(place.path("big.png"), Array3::from_elem((480, 640, 3), 0.4).view()).unwrap();
    write_image(place.path("poster.png"), Array3::from_elem((2400, 3200, 3), 0.4).view()).unwrap();
    write_image(place.path("picture.png"), image.view()).unwrap();
    let picture = image::open(place.path("picture.png")).unwrap();
    let save = |name: &str, picture: &DynamicImage, format| {
        picture.save_with_format(place.path(name), format).unwrap();
    };
    save("grey.png", &picture.to_luma8().into(), ImageFormat::Png);
    save("grey16.png", &picture.to_luma16().into(), ImageFormat::Png);
    save("grey-alpha.png", &picture.to_luma_alpha8().into(), ImageFormat::Png);
    save("alpha.png", &picture.to_rgba8().into(), ImageFormat::Png);
    save("rgb16.png", &picture.to_rgb16().into(), ImageFormat::Png);
    save("rgba16.png", &picture.to_rgba16().into(), ImageFormat::Png);
    save("grey.jpg", &picture.to_luma8().into(), ImageFormat::Jpeg);
    save("plain.jpg", &picture.to_rgb8().into(), ImageFormat::Jpeg);
    save("plain.webp", &picture, ImageFormat::WebP);
    save("plain.bmp", &picture, ImageFormat::Bmp);
    save("plain.tif", &picture, ImageFormat::Tiff);
    save("floats.tif", &picture.to_rgb32f().into(), ImageFormat::Tiff);
    let mut broken = picture.to_rgb32f();
    broken.put_pixel(3, 4, image::Rgb([f32::NAN, 0.0, 0.0]));
    save("nan.tif", &broken.into(), ImageFormat::Tiff);
    for (whole, half) in [
        ("picture.png", "half.png"),
        ("plain.jpg", "half.jpg"),
        ("plain.webp", "half.webp"),
        ("plain.bmp", "half.bmp"),
        ("plain.tif", "half.tif"),
    ] {
        let bytes = fs::read(place.path(whole)).unwrap();
        place.write(half, &bytes[..bytes.len() / 2]);
    }
    let progressive = fs::read(fixtures().join("progressive.jpg")).unwrap();
    for (whole, name) in
        [(fs::read(place.path("plain.jpg")).unwrap(), "cut.jpg"), (progressive, "cut-progressive.jpg")]
    {
        let mut cut = whole[..whole.len() * 6 / 10].to_vec();
        let mut zeroed = cut.clone();
        cut.extend([0xff, 0xd9]);
        place.write(name, cut);
        zeroed.resize(whole.len(), 0);
        zeroed.extend([0xff, 0xd9]);
        place.write("zeroed.jpg", zeroed);
    }
    let mut two_frames = fs::read(place.path("plain.jpg")).unwrap();
    // Behind the scan: progressive, 65500x65500, 255 components.
    let end = two_frames.len() - 2;
    let mut frame = vec![0xff, 0xc2, 0x03, 0x05, 8, 0xff, 0xdc, 0xff, 0xdc, 255];
    frame.extend((0..255).flat_map(|id| [id, 0x11, 0]));
    two_frames.splice(end..end, frame);
    place.write("two-frames.jpg", two_frames);
    place.write("wide.tif", wide_tiff(u16::to_le_bytes, u32::to_le_bytes, b"II"));
    place.write("wide-motorola.tif", wide_tiff(u16::to_be_bytes, u32::to_be_bytes, b"MM"));
    let png = fs::read(place.path("picture.png")).unwrap();
    place.write("no-extension", &png);
    place.write("wrong.jpg", &png);
    place.write("header.png", &png[..33]);
    place.write("signature.png", &png[..8]);
    // The header's checksum is not what keeps a size from being believed.
    place.write("huge.png", with_size(&png, 60_000, 60_000));
    place.write("line.png", with_size(&png, 1 << 27, 1));
    place.write("zero.png", with_size(&png, 0, 48));
    let mut damaged = png.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x55;
    place.write("damaged.png", damaged);
    place.write("empty.png", "");
    place.write("text.png", "this is no picture");
    place.write("drawing.svg", "<svg xmlns='http://www.w3.org/2000/svg' width='64' height='48'/>");
    place.write("photo.heic", b"\0\0\0\x18ftypheic\0\0\0\0mif1heic");
    place.write("page.pdf", "%PDF-1.7\n");
    for fixture in [
        "cmyk.jpg",
        "cmyk.tif",
        "progressive.jpg",
        "rotated.jpg",
        "palette.png",
        "bilevel.png",
        "animated.gif",
        "animated.png",
        "animated.webp",
    ] {
        fs::copy(fixtures().join(fixture), place.path(fixture)).unwrap();
    }
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

/// RGB samples of 32 bits without a sample format, which means unsigned integers.
fn wide_tiff(short: fn(u16) -> [u8; 2], long: fn(u32) -> [u8; 4], order: &[u8]) -> Vec<u8> {
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    let mut bytes = [order, &short(42), &long(8), &short(10)].concat();
    let after = 8 + 2 + 12 * 10 + 4;
    let bytes_of_strip = width * height * 12;
    for (tag, kind, count, value) in [
        (256_u16, 4_u16, 1_u32, long(width)),
        (257, 4, 1, long(height)),
        (258, 3, 3, long(after)),
        (259, 4, 1, long(1)),
        (262, 4, 1, long(2)),
        (273, 4, 1, long(after + 6)),
        (277, 4, 1, long(3)),
        (278, 4, 1, long(height)),
        (279, 4, 1, long(bytes_of_strip)),
        (284, 4, 1, long(1)),
    ] {
        bytes.extend([&short(tag)[..], &short(kind), &long(count), &value].concat());
    }
    bytes.extend([&long(0)[..], &short(32), &short(32), &short(32)].concat());
    (0..width * height * 3).for_each(|index| bytes.extend(long(index.wrapping_mul(9_000_000))));
    bytes
}

fn with_size(png: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png.to_vec();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let checksum = crc32fast::hash(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    bytes
}

fn maps(place: &Place) {
    let of = |value: f32| Array2::from_elem((HEIGHT, WIDTH), value);
    for (name, value) in [
        ("zero.npy", 0.0),
        ("negative.npy", -2.0),
        ("constant.npy", 2.0),
        ("infinite.npy", f32::INFINITY),
        ("denormal.npy", 1e-42),
        ("largest.npy", f32::MAX),
        ("large.npy", 1e9),
        ("tiny.npy", 1e-9),
    ] {
        write_npy(place.path(name), of(value).view()).unwrap();
    }
    let depth = &place.scene.depth;
    let sized = |height, width| Array2::from_shape_fn((height, width), |(y, x)| 1.0 + (x + y) as f32 * 0.01);
    for (name, height, width) in [
        ("small.npy", HEIGHT / 2, WIDTH / 2),
        ("turned.npy", WIDTH, HEIGHT),
        ("dot.npy", 1, 1),
        ("smallest.npy", 8, 8),
        ("long.npy", 8, 200),
        ("half-size.npy", 24, 32),
        ("big.npy", 480, 640),
    ] {
        write_npy(place.path(name), sized(height, width).view()).unwrap();
    }
    let only = Array2::from_shape_fn(depth.dim(), |at| if at == (20, 30) { 2.0 } else { 0.0 });
    write_npy(place.path("one-pixel.npy"), only.view()).unwrap();
    let holes =
        Array2::from_shape_fn(depth.dim(), |(y, x)| if (x + y) % 3 == 0 { 0.0 } else { depth[(y, x)] });
    write_npy(place.path("holes.npy"), holes.view()).unwrap();
    let half = Array2::from_shape_fn(depth.dim(), |(y, x)| if x < WIDTH / 2 { 0.0 } else { depth[(y, x)] });
    write_npy(place.path("half-missing.npy"), half.view()).unwrap();
    let extremes =
        Array2::from_shape_fn(depth.dim(), |(y, x)| if (x / 8 + y / 8) % 2 == 0 { 1e-3 } else { 1e3 });
    write_npy(place.path("extremes.npy"), extremes.view()).unwrap();
    let mixed = Array2::from_shape_fn(depth.dim(), |(y, x)| match (x + 2 * y) % 7 {
        0 => f32::INFINITY,
        1 => -1.0,
        2 => f32::NEG_INFINITY,
        _ => depth[(y, x)],
    });
    write_npy(place.path("mixed.npy"), mixed.view()).unwrap();
    let disparity = depth.mapv(|z| 3.0 / z - 2.0);
    write_npy(place.path("disparity.npy"), disparity.view()).unwrap();
    for name in ["depth.pfm", "depth.exr", "depth.npz"] {
        write_depth(place.path(name), depth.view(), &Default::default()).unwrap();
    }
    write_png16(place.path("depth.png"), depth.view(), 5000.0).unwrap();
    write_npz(place.path("two.npz"), &[("near", depth.view()), ("far", depth.view())]).unwrap();
    write_npz(place.path("three.npz"), &[("near", of(1.0).view()), ("depth", depth.view())]).unwrap();
    write_pfm(place.path("whole.pfm"), depth.view()).unwrap();
    for (whole, cut) in [
        ("depth.pfm", "short.pfm"),
        ("depth.exr", "short.exr"),
        ("depth.npz", "short.npz"),
        ("depth.png", "short-depth.png"),
    ] {
        let bytes = fs::read(place.path(whole)).unwrap();
        place.write(cut, &bytes[..bytes.len() - bytes.len() / 3]);
    }
    let png = fs::read(place.path("depth.png")).unwrap();
    place.write("line-depth.png", with_size(&png, 1 << 27, 1));
    for name in ["empty.npy", "empty.npz", "empty.pfm", "empty.exr", "empty-depth.png"] {
        place.write(name, "");
    }
    for name in ["text.npy", "text.npz", "text.pfm", "text.exr", "depth.txt", "depth"] {
        place.write(name, "this is no depth map, but a line of text");
    }
    place.write("colour.pfm", "PF\n2 2\n-1.0\n................................................");
    place.write("header.pfm", "Pf\n64\n");
    place.write("huge.pfm", "Pf\n99999999 99999999\n-1.0\n....");
    place.write("negative.pfm", "Pf\n-64 48\n-1.0\n....");
    place.write("unscaled.pfm", "Pf\n64 48\n0.0\n....");
    let mut big_endian = b"Pf\n64 48\n1.0\n".to_vec();
    big_endian.extend((0..WIDTH * HEIGHT).flat_map(|i| (2.0 + i as f32 * 1e-3).to_be_bytes()));
    place.write("big-endian.pfm", big_endian);
}

/// An NPY file of any header.
fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let header = format!("{header}\n");
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn arrays(place: &Place) {
    let header = |descr: &str, order: &str, shape: &str| {
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
    };
    let depth = |y: usize, x: usize| 2.0 + (x + 2 * y) as f64 * 0.01;
    let pixels = || (0..HEIGHT * WIDTH).map(|i| depth(i / WIDTH, i % WIDTH));
    let floats: Vec<u8> = pixels().flat_map(|v| (v as f32).to_le_bytes()).collect();
    let doubles: Vec<u8> = pixels().flat_map(f64::to_le_bytes).collect();
    let reversed: Vec<u8> = pixels().flat_map(|v| (v as f32).to_be_bytes()).collect();
    let shorts: Vec<u8> = pixels().flat_map(|v| ((1000.0 * v) as u16).to_le_bytes()).collect();
    let bytes: Vec<u8> = pixels().map(|v| (10.0 * v) as u8).collect();
    let shape = "(48, 64)";
    for (name, header, data) in [
        ("f8.npy", header("<f8", "False", shape), &doubles),
        ("f4be.npy", header(">f4", "False", shape), &reversed),
        ("fortran.npy", header("<f4", "True", shape), &floats),
        ("u2.npy", header("<u2", "False", shape), &shorts),
        ("u1.npy", header("|u1", "False", shape), &bytes),
        ("batch.npy", header("<f4", "False", "(1, 48, 64)"), &floats),
        ("channel.npy", header("<f4", "False", "(48, 64, 1)"), &floats),
        ("flat.npy", header("<f4", "False", "(3072,)"), &floats),
        ("scalar.npy", header("<f4", "False", "()"), &floats),
        ("stack.npy", header("<f4", "False", "(2, 24, 64)"), &floats),
        ("complex.npy", header("<c8", "False", shape), &floats),
        ("object.npy", header("|O", "False", shape), &floats),
        ("words.npy", header("<U4", "False", shape), &floats),
        ("bool.npy", header("|b1", "False", shape), &bytes),
        ("huge.npy", header("<f4", "False", "(99999999, 99999999)"), &floats),
        ("minus.npy", header("<f4", "False", "(-48, 64)"), &floats),
        ("none.shape.npy", header("<f4", "False", "(0, 64)"), &floats),
        ("no-descr.npy", "{'fortran_order': False, 'shape': (48, 64), }".into(), &floats),
        ("no-order.npy", "{'descr': '<f4', 'shape': (48, 64), }".into(), &floats),
        ("no-shape.npy", "{'descr': '<f4', 'fortran_order': False, }".into(), &floats),
    ] {
        place.write(name, npy(&header, data));
    }
    let good = npy(&header("<f4", "False", shape), &floats);
    place.write("short.npy", &good[..good.len() - 99]);
    place.write("header.npy", &good[..20]);
    let mut future = good.clone();
    future[6] = 9;
    place.write("future.npy", future);
    let mut nan = good.clone();
    let start = nan.len() - floats.len();
    let missing = f32::NAN.to_le_bytes();
    nan[start..start + 400].chunks_exact_mut(4).for_each(|v| v.copy_from_slice(&missing));
    place.write("some-nan.npy", &nan);
    nan[start..].chunks_exact_mut(4).for_each(|v| v.copy_from_slice(&missing));
    place.write("nan.npy", nan);
}

fn texts(place: &Place) {
    place.write("broken.toml", "seed = = 1\n");
    place.write("three.toml", "multi-view.max-views = 3\n");
    place.write("binary.toml", b"\xff\xfe\0\x01");
    place.write("broken.txt", "520 0 320 0 520");
    place.write("ten.txt", "520 0 32 0 520 24 0 0 1 7");
    place.write("letters.txt", "fx 0 cx 0 fy cy 0 0 1");
    place.write("zeros.txt", "0 0 0 0 0 0 0 0 0");
    place.write("focal-zero.txt", "0 0 32 0 520 24 0 0 1");
    place.write("focal-minus.txt", "-520 0 32 0 520 24 0 0 1");
    place.write("focal-nan.txt", "nan 0 32 0 520 24 0 0 1");
    place.write("focal-inf.txt", "inf 0 32 0 520 24 0 0 1");
    place.write("centre-nan.txt", "520 0 nan 0 520 24 0 0 1");
    place.write("skewed.txt", "520 9 32 0 520 24 0 0 1");
    place.write("skew-nan.txt", "520 nan 32 0 520 24 0 0 1");
    place.write("good.txt", "60 0 32.5\n0 60 24.5\n0 0 1\n");
    place.write("empty.txt", "");
    place.write("binary.txt", b"\xff\xfe5\x002\x000\x00");
    place.write("other.json", r#"{"fx": 9, "fy": 9, "cx": 1, "cy": 1, "width": 640, "height": 480}"#);
    place.write("partial.json", r#"{"fx": 60, "fy": 60}"#);
    place.write("typed.json", r#"{"fx": "60", "fy": 60, "cx": 32, "cy": 24}"#);
    place.write("broken.json", r#"{"fx": 60,"#);
    place.write("minus.json", r#"{"fx": -60, "fy": 60, "cx": 32, "cy": 24}"#);
    place.write("sized.json", r#"{"fx": 60, "fy": 60, "cx": 32, "cy": 24, "width": 64, "height": 48}"#);
    place.write("list.json", "[1, 2, 3]");
    place.write("fastdepth.onnx", "this is no model");
    place.write("mystery.onnx", "this is no model");
    place.write("empty.onnx", "");
    place.write("field.safetensors", "this is no field");
    place.write("empty.safetensors", "");
    place.write("file", "");
    fs::create_dir(place.path("folder.png")).unwrap();
    fs::create_dir(place.path("folder.npy")).unwrap();
    fs::create_dir(place.path("empty")).unwrap();
    fs::create_dir(place.path("thesis")).unwrap();
    place.write("thesis/chapter.txt", "years");
    fs::create_dir(place.path("earlier")).unwrap();
    place.write("earlier/run.json", "{}");
}

fn data_sets(place: &Place) {
    let scene = |set: &str, json: &str| {
        let folder = place.path(&format!("{set}/a"));
        fs::create_dir_all(&folder).unwrap();
        fs::copy(place.path("image.png"), folder.join("color.png")).unwrap();
        fs::copy(place.path("depth.npy"), folder.join("depth.npy")).unwrap();
        fs::write(folder.join("scene.json"), json).unwrap();
        folder
    };
    scene("good-set", r#"{"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}"#);
    scene("broken-set", "{");
    scene("typed-set", r#"{"fx": "wide"}"#);
    scene("partial-set", r#"{"fx": 60}"#);
    scene("minus-set", r#"{"fx": -60, "fy": 60, "cx": 31.5, "cy": 23.5}"#);
    scene("scale-set", r#"{"depth_units_per_metre": 0}"#);
    scene("reach-set", r#"{"max_depth": -1}"#);
    fs::copy(place.path("small.npy"), scene("size-set", "{}").join("depth.npy")).unwrap();
    fs::copy(place.path("half.png"), scene("picture-set", "{}").join("color.png")).unwrap();
    fs::remove_file(scene("bare-set", "{}").join("depth.npy")).unwrap();
    fs::copy(place.path("zero.npy"), scene("dark-set", "{}").join("depth.npy")).unwrap();
    fs::create_dir(place.path("priors")).unwrap();
    fs::copy(place.path("depth.npy"), place.path("priors/a.npy")).unwrap();
    for (folder, from) in
        [("nan-priors", "nan.npy"), ("small-priors", "small.npy"), ("cut-priors", "short.npy")]
    {
        fs::create_dir(place.path(folder)).unwrap();
        fs::copy(place.path(from), place.path(&format!("{folder}/a.npy"))).unwrap();
    }
    for (folder, from) in [
        ("maps", "depth.npy"),
        ("small-maps", "small.npy"),
        ("nan-maps", "nan.npy"),
        ("zero-maps", "zero.npy"),
    ] {
        fs::create_dir(place.path(folder)).unwrap();
        fs::copy(place.path(from), place.path(&format!("{folder}/a.npy"))).unwrap();
    }
    let sun = |set: &str, intrinsics: &str| {
        let folder = place.path(&format!("{set}/s"));
        fs::create_dir_all(folder.join("image")).unwrap();
        fs::create_dir_all(folder.join("depth")).unwrap();
        fs::copy(place.path("plain.jpg"), folder.join("image/a.jpg")).unwrap();
        fs::copy(place.path("depth.png"), folder.join("depth/a.png")).unwrap();
        fs::write(folder.join("intrinsics.txt"), intrinsics).unwrap();
    };
    sun("sun-letters", "fx 0 cx 0 fy cy 0 0 1");
    sun("sun-minus", "-60 0 32 0 60 24 0 0 1");
}
