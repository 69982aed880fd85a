//! Unusable input gives one line with the value at fault and the remedy, and leaves no files; unusual input works.
#![allow(clippy::unwrap_used)]

mod cameras;
mod captures;
#[path = "../common/mod.rs"]
mod common;
mod evaluations;
mod images;
mod inputs;
mod models;
mod outputs;
mod parsers;
mod priors;
mod records;
mod settings;
mod table;
mod usage;
mod values;

/// As many as docs/reliability.md states.
#[test]
fn there_are_more_than_seven_hundred_of_them() {
    let tests: &[fn()] = &[
        cameras::unusable_cameras,
        captures::captures_that_are_none,
        captures::wrong_usage_of_several_photographs,
        evaluations::unusable_views_and_renders,
        evaluations::unusable_evaluations,
        evaluations::unusable_scenes,
        evaluations::odd_evaluations,
        images::unusable_photographs,
        outputs::unusable_places,
        parsers::unusable_transforms,
        parsers::unusable_colmap_text,
        parsers::unusable_colmap_binaries,
        parsers::unusable_trajectories,
        priors::unusable_depth_maps,
        priors::known_depths_that_give_no_scale,
        priors::depths_that_no_field_can_hold,
        priors::truths,
        records::unusable_numbers_of_shards,
        records::unusable_lists,
        records::unusable_known_depths,
        records::unusable_fields,
        records::damaged_calibrations,
        records::unusable_maps_and_places,
        settings::unusable_settings,
        settings::unusable_calibrations,
        settings::unreadable_settings,
        usage::wrong_usage,
        values::unusable_values,
        values::unusable_values_of_settings,
        values::files_that_are_no_photographs,
        #[cfg(feature = "onnx")]
        models::unusable_models,
    ];
    let number = table::counted(tests);
    assert!(number > 700, "{number}");
}
