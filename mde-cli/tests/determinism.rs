//! The same bytes whatever the number of threads, and every time.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, TINY};
use std::fs;

/// What the field and a network add: the other field, and predictions of crops that run side by side.
#[test]
fn threads_change_no_byte_of_an_mlp_or_of_predictions() {
    let place = Place::new();
    let mlp = TINY
        .replace(
            "kind = 'hash'\nlevels = 4\nlog2-rows = 10\nfinest = 64\nwidth = 16",
            "kind = 'mlp'\nlayers = 2\nwidth = 16",
        )
        .replace("rays = 128", "rays = 131")
        .replace("steps = 60", "steps = 20");
    assert!(mlp.contains("mlp"));
    place.write("mlp.toml", mlp);
    let field = "--prior-depth depth.npy --preset paper --config mlp.toml";
    let mut runs = vec![("mlp", field)];
    if cfg!(feature = "onnx") {
        let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
        fs::copy(fixtures.join("grey_nchw.onnx"), place.path("grey.onnx")).unwrap();
        runs.push(("network", "--prior-model grey.onnx --model-profile fastdepth --predictions 5"));
    }
    for (name, rest) in runs {
        let bytes = [1, 2, 5].map(|threads| {
            let out = format!("{name}{threads}");
            let refine = format!("refine image.png {rest} --fov 60 --threads {threads} -q -o {out}");
            place.mde(&refine).assert().success();
            ["depth.npy", "sigma.npy", "prior.npy"].map(|map| fs::read(place.path(&out).join(map)).unwrap())
        });
        assert!(bytes[0][0] != bytes[0][2], "{name}: the result is the prior");
        assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2], "{name}");
    }
}

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
