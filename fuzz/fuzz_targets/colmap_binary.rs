//! A COLMAP model in binary: the lengths of cameras and images (two bytes each, little-endian), then cameras, images, points.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_fuzz::{check, folder, size};
use mde_mvs::capture::read_colmap;

fuzz_target!(|data: &[u8]| {
    let Some((&[a, b, c, d], rest)) = data.split_first_chunk::<4>() else { return };
    let cameras = usize::from(u16::from_le_bytes([a, b])).min(rest.len());
    let (cameras, rest) = rest.split_at(cameras);
    let images = usize::from(u16::from_le_bytes([c, d])).min(rest.len());
    let (images, points) = rest.split_at(images);
    let folder = folder(&[("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", points)]);
    check(read_colmap(&folder, &folder, &size));
});
