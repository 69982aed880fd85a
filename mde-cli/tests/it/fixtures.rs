//! The files that the cases name.

use crate::cases::{edited, expanded};
use crate::common::{HEIGHT, Place, WIDTH, copy, fixture, names};
use image::{DynamicImage, ImageFormat};
use mde_cli::mde_prior::format::{write_depth, write_npz, write_png16};
use ndarray::{Array2, Array3};
use ndarray_npy::write_npy;
use std::fs;
use std::path::Path;

/// With those of `cases/files.txt`, and on Unix `pipe.*`, which are never written to, and `endless.*`, which never end.
pub(crate) fn place() -> Place {
    let place = Place::new();
    for folder in ["folder.png", "folder.npy", "empty"] {
        fs::create_dir(place.path(folder)).unwrap();
    }
    copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures"), &place.path(""));
    for net in names(&fixture("")).iter().filter(|name| name.ends_with(".onnx")) {
        place.take(fixture(net), &format!("nets/{net}"));
    }
    place.take(fixture("external.bin"), "external.bin");
    place.write("calibration.toml", include_str!("../../src/refiner/calibration/default.toml"));
    pictures(&place);
    maps(&place);
    for line in include_str!("cases/files.txt").lines().filter(|line| !line.starts_with('#')) {
        let (paths, content) = line.split_once(':').unwrap();
        for path in expanded(paths) {
            place.write(&path, edited(&place, &path, content.trim_start()).unwrap());
        }
    }
    #[cfg(unix)]
    without_end(&place);
    place
        .run("refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --export field -q -o fit");
    fs::rename(place.path("fit/field.safetensors"), place.path("field.safetensors")).unwrap();
    place
}

#[cfg(unix)]
fn without_end(place: &Place) {
    fs::create_dir(place.path("pipes")).unwrap();
    let mut mkfifo = std::process::Command::new("mkfifo");
    mkfifo.args(["weights/external.bin", "toml/external.toml", "hub/config.json", "pipes/a.npy"]);
    for kind in ["png", "npy", "onnx", "toml", "txt", "json", "csv", "safetensors"] {
        mkfifo.arg(format!("pipe.{kind}"));
        std::os::unix::fs::symlink("/dev/zero", place.path(&format!("endless.{kind}"))).unwrap();
    }
    assert!(mkfifo.current_dir(place.path("")).status().unwrap().success());
}

fn pictures(place: &Place) {
    let image = Array3::from_shape_fn((HEIGHT, WIDTH, 3), |(y, x, c)| {
        ((x * (c + 1)) as f32 / 9.0).sin() * 0.3 + y as f32 / 200.0 + 0.4
    });
    place.photograph("picture.png", image.view());
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
        place.photograph(name, Array3::from_elem((height, width, 3), value).view());
    }
    let picture = image::open(place.path("picture.png")).unwrap();
    let mut broken = picture.to_rgb32f();
    broken.put_pixel(3, 4, image::Rgb([f32::NAN, 0.0, 0.0]));
    let pictures: [(&str, DynamicImage); 13] = [
        ("grey.png", picture.to_luma8().into()),
        ("grey16.png", picture.to_luma16().into()),
        ("grey-alpha.png", picture.to_luma_alpha8().into()),
        ("alpha.png", picture.to_rgba8().into()),
        ("rgb16.png", picture.to_rgb16().into()),
        ("rgba16.png", picture.to_rgba16().into()),
        ("grey.jpg", picture.to_luma8().into()),
        ("plain.jpg", picture.to_rgb8().into()),
        ("plain.webp", picture.clone()),
        ("plain.bmp", picture.clone()),
        ("plain.tif", picture.clone()),
        ("floats.tif", picture.to_rgb32f().into()),
        ("nan.tif", broken.into()),
    ];
    for (name, picture) in pictures {
        picture.save_with_format(place.path(name), ImageFormat::from_path(name).unwrap()).unwrap();
    }
}

fn maps(place: &Place) {
    let depth = &place.scene.depth;
    // Any values: the program's own writer of maps refuses NaN.
    let of_depth = |name: &str, value: &dyn Fn(usize, usize, f32) -> f32| {
        let map = Array2::from_shape_fn(depth.dim(), |(y, x)| value(y, x, depth[(y, x)]));
        write_npy(place.path(name), &map).unwrap();
    };
    of_depth("holes.npy", &|y, x, z| if (x + y) % 3 == 0 { 0.0 } else { z });
    of_depth("half-missing.npy", &|_, x, z| if x < WIDTH / 2 { 0.0 } else { z });
    of_depth("extremes.npy", &|y, x, _| if (x / 8 + y / 8) % 2 == 0 { 1e-3 } else { 1e3 });
    of_depth("some-nan.npy", &|y, _, z| if y < 2 { f32::NAN } else { z });
    of_depth("mixed.npy", &|y, x, z| {
        [f32::INFINITY, -1.0, f32::NEG_INFINITY].get((x + 2 * y) % 7).copied().unwrap_or(z)
    });
    of_depth("disparity.npy", &|_, _, z| 3.0 / z - 2.0);
    for name in ["depth.pfm", "depth.exr", "depth.npz"] {
        write_depth(place.path(name), depth.view()).unwrap();
    }
    write_png16(place.path("depth.png"), depth.view(), 5000.0).unwrap();
    write_npz(place.path("two.npz"), &[("near", depth.view()), ("far", depth.view())]).unwrap();
    write_npz(place.path("three.npz"), &[("near", depth.view()), ("depth", depth.view())]).unwrap();
}
