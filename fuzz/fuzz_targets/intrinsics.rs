//! Camera files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_cli::scene::intrinsics::Intrinsics;

fuzz_target!(|text: &str| {
    match Intrinsics::parse(text) {
        Ok(k) => {
            let size = [k.width.unwrap_or(64), k.height.unwrap_or(48)];
            if let Ok(camera) = k.camera(size) {
                assert!(camera.fx > 0.0 && camera.fy.is_finite() && camera.cx.is_finite());
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
