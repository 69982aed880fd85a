//! Photographs: the check of a JPEG's data, and the decoders behind it. Depth in a PNG: its texts.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_prior::format::{Format, ReadOptions, decode};
use mde_cli::mde_prior::photo::decode_image;

fuzz_target!(|data: &[u8]| {
    match decode_image(data) {
        Ok(photo) => {
            let (height, width, channels) = photo.pixels.dim();
            assert!(height > 0 && width > 0 && channels == 3);
            assert!(photo.pixels.iter().all(|v| (0.0..=1.0).contains(v)));
            assert!(photo.focal_35mm.is_none_or(|focal| focal > 0.0));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    if let Ok(map) = decode(Format::Png, data, &ReadOptions::default()) {
        assert!(!map.is_empty() && map.iter().all(|v| !v.is_nan()));
    }
});
