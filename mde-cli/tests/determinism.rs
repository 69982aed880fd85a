//! The same bytes whatever the number of threads, and every time.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, TINY};
use std::fs;

#[test]
fn threads_and_repetition_change_no_byte() {
    let place = Place::new();
    // Rows that no number of threads divides.
    place.write("tiny.toml", TINY.replace("rays = 128", "rays = 131").replace("steps = 60", "steps = 20"));
    for preset in ["paper", "default", "fast"] {
        let mut first = None;
        for (index, (threads, variable)) in [
            ("1", None),
            ("2", None),
            ("5", None),
            ("2", None),
            ("", Some("1")),
            ("", Some("2")),
            ("", Some("5")),
        ]
        .into_iter()
        .enumerate()
        {
            let out = format!("{preset}{index}");
            let mut command = place.mde(&format!(
                "refine image.png --prior-depth depth.npy --fov 60 --preset {preset} --config tiny.toml -q -o {out}"
            ));
            command.env_remove("RAYON_NUM_THREADS");
            if let Some(threads) = variable {
                command.env("RAYON_NUM_THREADS", threads);
            } else {
                command.args(["--threads", threads]);
            }
            command.assert().success();
            let bytes = ["depth.npy", "sigma.npy"].map(|name| fs::read(place.path(&out).join(name)).unwrap());
            let prior = fs::read(place.path(&out).join("prior.npy")).unwrap();
            assert!(bytes[0] != prior, "{preset}: the field has no part in it");
            let expected = first.get_or_insert_with(|| bytes.clone());
            assert!(*expected == bytes, "{preset}: {threads} {variable:?}");
        }
    }
}
