//! The description of one's own scene.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mde_eval::data::PlainScene;

fuzz_target!(|text: &str| {
    if let Ok(scene) = PlainScene::parse(text) {
        assert!(scene.max_depth.is_none_or(|depth| depth > 0.0 && depth.is_finite()));
        if let Ok(Some(camera)) = scene.camera(64, 48) {
            assert!(camera.fx > 0.0 && camera.cy.is_finite());
        }
    }
});
