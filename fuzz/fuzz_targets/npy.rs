//! NumPy's arrays and archives of them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_prior::format::{Format, ReadOptions, decode};

fuzz_target!(|data: &[u8]| {
    if let Ok(map) = decode(Format::Npy, data, &ReadOptions::default()) {
        assert!(!map.is_empty() && map.len() <= data.len() && map.iter().all(|v| !v.is_nan()));
    }
    for npz_array in [None, Some("depth".to_owned())] {
        let options = ReadOptions { npz_array, ..ReadOptions::default() };
        if let Ok(map) = decode(Format::Npz, data, &options) {
            assert!(!map.is_empty() && map.iter().all(|v| !v.is_nan()));
        }
    }
});
