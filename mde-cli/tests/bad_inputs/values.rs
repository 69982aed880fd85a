//! Values of arguments and settings, and photographs of kinds that no one reads.

use crate::common::Place;
use crate::table::{Case, QUICK, check, misused, refused};

#[test]
pub(crate) fn unusable_values() {
    let of = |rest: &str, told: &[&'static str]| {
        misused(format!("refine image.png --prior-depth depth.npy {rest} -o out"), told)
    };
    let positive = ["--work-size", "--near", "--far", "--max-memory"];
    let mut cases = Vec::new();
    for flag in positive {
        for value in ["-1", "nan", "inf", "1e999", "", "1,5"] {
            cases.push(of(&format!("{flag}={value}"), &["give a positive number"]));
        }
    }
    for value in ["0", "1", "-0.9", "90", "90%", "inf", "", "0.001"] {
        cases.push(of(&format!("--interval={value}"), &["--interval", "0.01 to 0.99"]));
    }
    for value in ["-1", "1.5", "", "all", "99999999999", "0x4"] {
        cases.push(of(&format!("--predictions={value}"), &["--predictions"]));
    }
    for value in ["7", "-64", "large", "4294967296", "64x48"] {
        cases.push(of(&format!("--max-size={value}"), &["--max-size"]));
    }
    for value in ["7x48", "64", "64x", "x48", "64x48x3", "-64x48", "64.5x48", "64*48"] {
        cases.push(misused(format!("demo --size={value} -o out"), &["--size", "8 to 16384"]));
    }
    for value in ["zip", "ply,zip", "PLY", ""] {
        cases.push(of(&format!("--export={value}"), &["--export", "ply"]));
    }
    check(&cases);
}

/// A TOML text and what the message must contain.
const SETTINGS: &[(&str, &[&str])] = &[
    ("seed = 1.5", &["seed", "1.5"]),
    ("seed = 1\nseed = 2", &["seed", "duplicate"]),
    ("seed = true", &["seed", "boolean"]),
    ("[[nerf]]", &["nerf"]),
    ("nerf = 3", &["nerf", "3"]),
    ("'' = 1", &["unknown"]),
    ("\u{feff}colour = 1", &["colour"]),
    ("a = { b = { c = [1, [2, [3]]] } }", &["`a`"]),
    ("nerf.train.steps = '100'", &["steps", "string"]),
    ("nerf.train.steps = -1", &["steps", "-1"]),
    ("nerf.train.rays = 1e3", &["rays", "1000"]),
    ("nerf.train.learning-rate = inf", &["learning-rate", "inf"]),
    ("nerf.train.learning-rate = -0.1", &["learning-rate", "-0.1"]),
    ("nerf.train.warm-up = -1", &["warm-up", "-1"]),
    ("nerf.train.original-share = nan", &["original-share", "NaN"]),
    ("nerf.field.kind = 3", &["kind"]),
    ("nerf.field.levels = 0", &["levels is 0", "1 to 24"]),
    ("nerf.field.width = 0", &["width is 0"]),
    ("nerf.field.log2-rows = 3", &["log2-rows is 3", "4 to 24"]),
    ("nerf.field.coarsest = 0", &["coarsest is 0"]),
    ("nerf.train.depth-weight = nan", &["depth-weight is NaN"]),
    ("nerf.sampling.band-width = 0.1", &["unknown", "band-width"]),
    ("nerf.render.in-bin = 'round'", &["`round`"]),
    ("fusion.kappa = nan", &["kappa is NaN"]),
    ("fusion.kappa = -1.0", &["kappa is -1"]),
    ("fusion.variance-floor = nan", &["variance-floor is NaN"]),
    ("fusion.common-error = -0.5", &["common-error"]),
    ("views.count = -1", &["count", "-1"]),
    ("views.translation = -0.1", &["translation is -0.1"]),
    ("views.rotation-degrees = 31", &["rotation-degrees is 31", "0 to 30"]),
    ("warp.tear = nan", &["tear is NaN"]),
    ("refinement.iterations = -1", &["iterations", "-1"]),
    ("disparity.far = inf", &["disparity.far is inf"]),
    ("disparity.near = -0.8", &["disparity.near is -0.8"]),
    ("multi-view.max-views = 65", &["max-views is 65", "2 to 64"]),
    ("augmentation.levels = 3", &["levels"]),
    ("sigma.spread = -1.0", &["sigma.spread"]),
    ("sigma.spread = nan", &["sigma.spread"]),
];

#[test]
pub(crate) fn unusable_values_of_settings() {
    let texts = Place::new();
    let mut cases = Vec::new();
    for (index, (text, told)) in SETTINGS.iter().enumerate() {
        let name = format!("values-{index}.toml");
        texts.write(&name, text);
        let told: Vec<_> = told.iter().copied().chain(["values-"]).collect();
        let path = texts.path(&name);
        cases.push(refused(
            format!("refine image.png --prior-depth depth.npy --config {}", path.display()),
            &told,
        ));
    }
    check(&cases);
}

/// The first bytes of files that are named or begin as photographs do.
const PHOTOGRAPHS: &[(&str, &[u8])] = &[
    ("a.jp2", b"\0\0\0\x0cjP  \r\n\x87\n\0\0\0\x14ftypjp2 "),
    ("a.jxl", b"\0\0\0\x0cJXL \r\n\x87\n"),
    ("naked.jxl", b"\xff\x0a\x00\x00"),
    ("a.avif", b"\0\0\0\x1cftypavif\0\0\0\0avifmif1"),
    ("a.psd", b"8BPS\0\x01\0\0\0\0\0\0\0\x03\0\0\0\x30\0\0\0\x40\0\x08\0\x03"),
    ("a.ico", b"\0\0\x01\0\x01\0\x10\x10\0\0\x01\0\x18\0"),
    ("a.qoi", b"qoif\0\0\0\x40\0\0\0\x30\x03\0"),
    ("a.ppm", b"P6\n64 48\n255\n"),
    ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 48 +X 64\n"),
    ("a.dds", b"DDS |\0\0\0"),
    ("a.ff", b"farbfeld\0\0\0\x40\0\0\0\x30"),
    ("a.exr", b"v/1\x01\x02\0\0\0"),
    ("a.mp4", b"\0\0\0\x20ftypisom\0\0\x02\0isomiso2"),
    ("a.zip", b"PK\x03\x04\x14\0"),
    ("a.gz", b"\x1f\x8b\x08\0\0\0\0\0"),
    ("a.elf", b"\x7fELF\x02\x01\x01"),
    ("a.html", b"<!DOCTYPE html><title>404 Not Found</title>"),
    ("git-lfs.jpg", b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n"),
    ("soi.jpg", b"\xff\xd8"),
    ("soi-eoi.jpg", b"\xff\xd8\xff\xd9"),
    ("markers.jpg", b"\xff\xd8\xff\xff\xff\xff\xff\xff"),
    ("lossless.jpg", b"\xff\xd8\xff\xc3\0\x0b\x08\0\x30\0\x40\x01\x01\x11\0\xff\xd9"),
    ("arithmetic.jpg", b"\xff\xd8\xff\xc9\0\x0b\x08\0\x30\0\x40\x01\x01\x11\0\xff\xd9"),
    ("deep.jpg", b"\xff\xd8\xff\xc1\0\x0b\x0c\0\x30\0\x40\x01\x01\x11\0\xff\xd9"),
    ("flat.jpg", b"\xff\xd8\xff\xc0\0\x0b\x08\0\0\0\x40\x01\x01\x11\0\xff\xd9"),
    ("zero.bmp", b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\0\0\0\0\0\0\0\0\x01\0\x18\0"),
    ("minus.bmp", b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff\x01\0\x18\0"),
    ("head.bmp", b"BM"),
    ("head.webp", b"RIFF\x10\0\0\0WEBP"),
    ("other.webp", b"RIFF\x10\0\0\0WAVEfmt \x10\0\0\0"),
    ("head.tif", b"II*\0"),
    ("loop.tif", b"II*\0\x08\0\0\0\x01\0\0\x01\x03\0\x01\0\0\0\x40\0\0\0\x08\0\0\0"),
    ("far.tif", b"II*\0\xff\xff\xff\x7f"),
    ("big.tif", b"II+\0\x08\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff"),
    ("zeros.png", &[0; 64]),
    ("spaces.jpg", b"                                "),
];

#[test]
pub(crate) fn files_that_are_no_photographs() {
    let place = Place::new();
    let mut files: Vec<(String, Vec<u8>)> =
        PHOTOGRAPHS.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())).collect();
    // A PNG of colour, bit depth, compression, filter or interlacing that there is none of.
    let png = std::fs::read(place.path("image.png")).unwrap();
    for (at, value, name) in [
        (24, 3, "depth"),
        (24, 32, "samples"),
        (25, 5, "colour"),
        (25, 3, "palette"),
        (26, 1, "compression"),
        (27, 1, "filter"),
        (28, 2, "interlace"),
    ] {
        let mut changed = png.clone();
        changed[at] = value;
        let checksum = crc32fast::hash(&changed[12..29]);
        changed[29..33].copy_from_slice(&checksum.to_be_bytes());
        files.push((format!("{name}.png"), changed));
    }
    let mut wrong = png.clone();
    wrong[29] ^= 1;
    files.push(("checksum.png".into(), wrong));
    files.push(("no-end.png".into(), png[..png.len() / 3].to_vec()));
    let cases: Vec<Case> = files
        .into_iter()
        .map(|(name, bytes)| {
            place.write(&name, bytes);
            let told: &[&'static str] = &["give a JPEG, PNG, TIFF, BMP or WebP"];
            refused(format!("refine {} --prior-depth depth.npy {QUICK}", place.path(&name).display()), told)
        })
        .collect();
    check(&cases);
}
