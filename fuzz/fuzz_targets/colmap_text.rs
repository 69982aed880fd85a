//! A COLMAP model as text: cameras, images and points, separated by the byte 0x1e.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_fuzz::{check, folder, size, write};
use mde_mvs::capture::read_colmap;

fuzz_target!(|data: &[u8]| {
    let folder = folder();
    let mut parts = data.splitn(3, |byte| *byte == 0x1e);
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        write(&folder, name, parts.next().unwrap_or_default());
    }
    check(read_colmap(&folder, &folder, &size));
});
