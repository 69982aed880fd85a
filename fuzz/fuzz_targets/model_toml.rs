//! Descriptions of models; each valid one gives an input size for any image.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_prior::ModelSpec;

fuzz_target!(|text: &str| {
    if let Ok(spec) = ModelSpec::from_toml(text) {
        for (height, width) in [(1, 1), (480, 640), (1, 16_384), (16_384, 1)] {
            let (h, w) = spec.input_size(height, width);
            assert!(h > 0 && w > 0);
        }
    }
});
