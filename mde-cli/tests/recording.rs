//! `--rerun` through the built program, with the feature and without.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, names};
use std::fs;

const REFINE: &str = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml";

#[cfg(feature = "rerun")]
#[test]
fn a_recording_is_written_beside_the_results_or_within_them() {
    let place = Place::new();
    for file in ["new/run.rrd", "out/run.rrd"] {
        place.mde(&format!("{REFINE} -o out --force --rerun {file}")).assert().success();
        let bytes = fs::read(place.path(file)).unwrap();
        assert!(bytes.starts_with(b"RRF"), "{file}");
        assert!(names(&place.path("out")).contains(&"depth.npy".to_owned()));
    }
    fs::write(place.path("old.rrd"), "old").unwrap();
    let refused = place.mde(&format!("{REFINE} -o other --rerun old.rrd")).assert().failure();
    assert!(String::from_utf8_lossy(&refused.get_output().stderr).contains("old.rrd: the file exists"));
    assert_eq!(fs::read(place.path("old.rrd")).unwrap(), b"old");
    assert!(!place.path("other").exists());
}

#[cfg(not(feature = "rerun"))]
#[test]
fn a_program_without_recordings_says_how_to_get_one_that_has_them() {
    let place = Place::new();
    let refused = place.mde(&format!("{REFINE} -o out --rerun run.rrd")).assert().failure();
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(said.contains("run.rrd") && said.contains("--features rerun"), "{said}");
    let left = names(fs::canonicalize(place.path(".")).unwrap().as_path());
    assert!(!left.contains(&"out".to_owned()) && !left.contains(&"run.rrd".to_owned()), "{left:?}");
}
