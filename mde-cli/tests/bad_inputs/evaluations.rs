//! Evaluations, ablations, views and renders.

use crate::table::{Case, check, count, misused, refused, works};

/// Some scenes failed: exit code 3.
fn partly(arguments: &str, told: &[&'static str]) -> Case {
    Case { arguments: arguments.into(), code: 3, told: told.to_vec() }
}

#[test]
pub(crate) fn unusable_views_and_renders() {
    check(&[
        refused("warp none.png --prior-depth depth.npy", &["none.png", "check the path"]),
        refused("warp image.png --prior-depth turned.npy", &["turned.npy", "64x48"]),
        refused("warp image.png --prior-depth zero.npy", &["zero.npy", "no usable pixel"]),
        refused("warp image.png --prior-depth depth.npy --fov 0", &["field of view is 0"]),
        refused("render --field none.safetensors --size 64x48", &["none.safetensors", "check the path"]),
        refused(
            "render --field empty.safetensors --size 64x48",
            &["empty.safetensors", "not a usable field"],
        ),
        refused(
            "render --field field.safetensors --size 64x48",
            &["field.safetensors", "not a usable field"],
        ),
        refused("render --field depth.npy --size 64x48", &["depth.npy", "not a usable field"]),
        refused("render --field folder.png --size 64x48", &["folder.png"]),
        refused("render --field field.safetensors --size 64x48 --fx -3", &["fx is -3"]),
        misused("render --field f --size 64x48 --orbit 3 --translate 1,2,3 -o out", &["cannot be used with"]),
        misused("render --field f --size 64x48 --orbit 0 -o out", &["--orbit"]),
        misused("render --field f --size 64x48 --translate 1,2 -o out", &["three numbers"]),
        misused("render --field f --size 64x48 --translate nan,0,0 -o out", &["three numbers"]),
        misused("render --field f --size 7x48 -o out", &["8 to 16384"]),
        misused("render --size 64x48 -o out", &["--field"]),
    ]);
}

#[test]
pub(crate) fn unusable_evaluations() {
    check(&[
        refused("eval", &["--dataset rooms"]),
        refused("eval none --dataset sunrgbd --prior-depth priors", &["none"]),
        refused("eval none --prior-depth priors", &["none"]),
        refused("eval empty --prior-depth priors", &["empty"]),
        refused("eval priors --dataset plain --prior-depth priors", &["priors", "scene.json"]),
        refused("eval good-set --dataset sunrgbd --prior-depth priors", &["good-set", "image/"]),
        refused("eval good-set", &["--prior-model", "--prior-depth"]),
        refused("eval good-set --simulated-prior", &["--simulated-prior", "--dataset rooms"]),
        refused("eval --dataset rooms --methods blur", &["`blur`", "guided"]),
        refused("eval --dataset rooms --methods jbf,jbf", &["jbf", "twice"]),
        refused("eval --dataset rooms --methods none.toml", &["none.toml"]),
        refused("eval --dataset rooms --methods broken.toml", &["broken.toml"]),
        refused("eval --dataset rooms --methods three.toml", &["three.toml", "--preset multi-view"]),
        refused("eval --dataset rooms --scenes attic", &["attic", "study-0"]),
        refused("eval --pred none --gt maps", &["none"]),
        refused("eval --pred maps --gt none", &["none"]),
        refused("eval --pred empty --gt maps", &["empty"]),
        refused("eval --pred maps --gt maps --scenes b", &["--scenes", "maps"]),
        refused("ablate --dataset rooms --rows best", &["best", "min-depth"]),
        misused("eval --dataset kitti x -o e", &["sunrgbd"]),
        misused("eval --dataset rooms --size 4x4 -o e", &["8 to 16384"]),
        misused("eval --dataset rooms --limit 0 -o e", &["--limit"]),
        misused("eval --dataset rooms --jobs 0 -o e", &["--jobs"]),
        misused("eval --pred maps -o e", &["--gt"]),
        misused("eval --pred maps --gt maps --methods jbf -o e", &["--methods"]),
        misused("ablate --dataset rooms --seeds 0 -o e", &["--seeds"]),
        misused("config --preset best", &["best", "paper"]),
    ]);
}

/// The only scene fails, so nothing could be scored; the folder of the evaluation may stay.
#[test]
pub(crate) fn unusable_scenes() {
    let place = crate::inputs::place();
    let eval = |rest: &str| {
        let out = tempfile::tempdir().unwrap();
        let run = place
            .mde(&format!("eval {rest} --methods guided --quiet -o"))
            .arg(out.path().join("e"))
            .output()
            .unwrap();
        (run.status.code(), String::from_utf8(run.stderr).unwrap())
    };
    let cases: [(&str, &[&str]); 17] = [
        ("broken-set --prior-depth priors", &["scene.json", "is not valid"]),
        ("typed-set --prior-depth priors", &["scene.json", "wide"]),
        ("partial-set --prior-depth priors", &["scene.json", "all four or none"]),
        ("minus-set --prior-depth priors", &["scene.json", "fx is -60"]),
        ("scale-set --prior-depth priors", &["scene.json", "depth_units_per_metre is 0"]),
        ("reach-set --prior-depth priors", &["scene.json", "max_depth is -1"]),
        ("size-set --prior-depth priors", &["depth.npy", "32x24", "64x48"]),
        ("picture-set --prior-depth priors", &["color.png", "give a JPEG"]),
        ("bare-set --prior-depth priors", &["0 files named depth.*"]),
        ("dark-set --prior-depth priors", &["no pixel"]),
        ("good-set --prior-depth empty", &["no depth map a.npy"]),
        ("good-set --prior-depth nan-priors", &["a.npy", "no usable pixel"]),
        ("good-set --prior-depth small-priors", &["a.npy", "32x24", "64x48"]),
        ("good-set --prior-depth cut-priors", &["a.npy", "truncated"]),
        ("good-set --prior-depth priors --max-depth 0.0001", &["max-depth"]),
        ("sun-letters --prior-depth priors", &["intrinsics.txt", "3 x 3"]),
        ("sun-minus --prior-depth priors", &["intrinsics.txt", "fx is -60"]),
    ];
    if count(cases.len()) {
        return;
    }
    let mut faults = Vec::new();
    for (arguments, told) in cases {
        let (code, message) = eval(arguments);
        let said = message.starts_with("error: ") && message.trim_end().lines().count() == 1;
        if code != Some(1) || !said || !told.iter().all(|part| message.contains(part)) {
            faults.push(format!("{arguments}: {code:?} {message}"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
pub(crate) fn odd_evaluations() {
    check(&[
        works("eval good-set --prior-depth priors --methods guided"),
        works("eval --pred maps --gt maps"),
        refused("eval --pred small-maps --gt maps", &["a.npy", "[24, 32]", "[48, 64]"]),
        refused("eval --pred nan-maps --gt maps", &["a.npy", "no pixel"]),
        refused("eval --pred maps --gt zero-maps", &["a.npy", "no pixel"]),
        partly(
            "eval --dataset rooms --size 64x48 --limit 1 --methods guided,zoom",
            &["zoom", "name a model"],
        ),
    ]);
}
