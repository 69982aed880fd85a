//! Known depths in a CSV file: what is read is positive and finite.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::scene::known::KnownDepths;
use mde_fuzz::folder;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let file = folder(&[("known.csv", data)]).join("known.csv");
    match KnownDepths::open(&file, Path::new("a.jpg"), (6, 8)) {
        Ok(known) => {
            let depths = known.at((6, 8));
            assert!(!depths.is_empty());
            assert!(depths.iter().all(|known| known.depth > 0.0 && known.depth.is_finite()));
            assert!(depths.iter().all(|known| known.sigma >= 0.0 && known.sigma.is_finite()));
        }
        Err(error) => assert!(error.to_string().contains("known.csv")),
    }
});
