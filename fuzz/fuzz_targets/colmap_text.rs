//! A COLMAP model as text: cameras, images and points, separated by the byte 0x1e.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_fuzz::{check, folder, size};
use mde_mvs::capture::read_colmap;

fuzz_target!(|data: &[u8]| {
    let mut parts = data.splitn(3, |byte| *byte == 0x1e);
    let names = ["cameras.txt", "images.txt", "points3D.txt"];
    let folder = folder(&names.map(|name| (name, parts.next().unwrap_or_default())));
    check(read_colmap(&folder, &folder, &size));
});
