//! Camera files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_mvs::capture::intrinsics;

fuzz_target!(|text: &str| {
    match intrinsics(text, [640, 480]) {
        Ok(camera) => assert!(camera.fx > 0.0 && camera.fy.is_finite() && camera.cx.is_finite()),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
