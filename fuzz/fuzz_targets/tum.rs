//! A trajectory of the TUM benchmark: `rgb.txt` and `groundtruth.txt`, separated by the byte 0x1e.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_warp::PinholeCamera;
use mde_fuzz::{SIZE, check, folder, size};
use mde_mvs::capture::{Distortion, Lens, read_tum};

fuzz_target!(|data: &[u8]| {
    let mut parts = data.splitn(2, |byte| *byte == 0x1e);
    let names = ["rgb.txt", "groundtruth.txt"];
    let folder = folder(&names.map(|name| (name, parts.next().unwrap_or_default())));
    let [width, height] = SIZE;
    let camera = PinholeCamera::from_fov(60.0, width, height).expect("a camera");
    check(read_tum(&folder, &Lens { camera, distortion: Distortion::default() }, &size));
});
