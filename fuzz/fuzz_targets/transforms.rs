//! nerfstudio's `transforms.json`, with pixel centres at integers and at halves.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_fuzz::{check, folder, size};
use mde_mvs::capture::{PixelCentres, read_transforms};

fuzz_target!(|data: &[u8]| {
    let folder = folder(&[("transforms.json", data)]);
    for centres in [PixelCentres::Integers, PixelCentres::Halves] {
        check(read_transforms(&folder.join("transforms.json"), centres, &size));
    }
});
