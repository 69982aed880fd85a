//! Configurations.

use crate::common::Place;
use crate::table::{check, misused, refused};
use std::fs;

/// A TOML text and what the message must contain.
const UNUSABLE: &[(&str, &[&str])] = &[
    ("colour = 1", &["`colour`", "`refinement`"]),
    ("[optics]\nlens = 1", &["`optics`"]),
    ("[nerf.train]\nstep = 3", &["`step`", "`steps`"]),
    ("[nerf.field]\nkind = 'splat'", &["`splat`", "`hash`"]),
    ("[nerf.field]\nlevel = 4", &["nerf.field", "`level`"]),
    ("[fusion]\ncalibration = 'magic'", &["`magic`", "`wls`"]),
    ("refinement.order = 'loose'", &["`loose`", "`poses`"]),
    ("seed = -1", &["seed", "-1"]),
    ("seed = 'x'", &["seed", "string"]),
    ("seed = 99999999999999999999", &["seed"]),
    ("refinement = 3", &["refinement"]),
    ("views.count = 2.5", &["count", "2.5"]),
    ("refinement.iterations = 101", &["refinement.iterations is 101", "to 100"]),
    ("refinement.prior = 'none'", &["`none`", "`carry`"]),
    ("views.count = 2000000", &["count is 2000000", "1000000"]),
    ("views.translation = 0.7", &["translation is 0.7", "0 to 0.5"]),
    ("views.translation = nan", &["translation is NaN", "0 to 0.5"]),
    ("views.rotation-degrees = -1", &["rotation-degrees is -1", "0 to 30"]),
    ("warp.tear = 2.0", &["tear is 2", "0 to 1"]),
    ("warp.taer = 0.1", &["`taer`", "`tear`"]),
    ("nerf.train.steps = 0", &["train.steps is 0", "1 to 1000000"]),
    ("nerf.train.steps = 2000000", &["train.steps is 2000000", "1 to 1000000"]),
    ("nerf.train.rays = 1", &["train.rays is 1", "16 to 65536"]),
    ("nerf.train.learning-rate = 0.0", &["train.learning-rate is 0", "positive"]),
    ("nerf.train.learning-rate = nan", &["train.learning-rate is NaN", "positive"]),
    ("nerf.train.original-share = 1.5", &["train.original-share is 1.5", "0 to 1"]),
    ("nerf.train.depth-weight = -1.0", &["train.depth-weight is -1", "0 or more"]),
    ("nerf.train.colour-loss = 'cubic'", &["`cubic`", "`charbonnier`"]),
    ("nerf.sampling.volume.margin = 0.1", &["`nerf.sampling.volume.margin`", "mde config"]),
    ("nerf.field = { kind = 'mlp', levels = 4 }", &["nerf.field", "`levels`"]),
    ("nerf.sampling = { coarse = 0, band = 0 }", &["sampling.coarse + sampling.band is 0", "2 to 1024"]),
    ("nerf.sampling.fine = 5000", &["sampling.fine is 5000", "1024"]),
    ("nerf.sampling.near = -1.0", &["unknown", "near"]),
    ("multi-view.max-views = 1", &["multi-view.max-views is 1", "2 to 64"]),
    ("nerf.render.coarse = 1", &["render.coarse is 1", "2 to 1024"]),
    ("nerf.field = { kind = 'mlp', layers = 0 }", &["field.layers is 0", "1 to 16"]),
    ("nerf.field.levels = 99", &["field.levels is 99", "1 to 24"]),
    ("nerf.field.features = 3", &["field.features is 3", "1, 2, 4 or 8"]),
    ("nerf.field.log2-rows = 30", &["field.log2-rows is 30", "4 to 24"]),
    ("nerf.field.finest = 4", &["field.finest is 4", "field.coarsest"]),
    ("fusion.variance-floor = 1.0", &["variance-floor is 1", "below 1"]),
    ("fusion.kappa = 0.0", &["kappa is 0", "positive"]),
    ("nerf.sampling.volume = { kind = 'sphere' }", &["`sphere`", "`hull`"]),
    ("augmentation.predictions = 0", &["1 or more"]),
    ("augmentation.predictions = 'many'", &["many", "auto"]),
    ("augmentation.predictions = 2.5", &["predictions"]),
    ("augmentation.levels = []", &["`levels`"]),
    ("disparity.near = 0.0", &["disparity.near is 0", "above 0"]),
    ("disparity = { near = 2.0, far = 1.0 }", &["disparity.far is 1", "above disparity.near"]),
];

#[test]
pub(crate) fn unusable_settings() {
    let texts = Place::new();
    let mut cases = Vec::new();
    for (index, (text, told)) in UNUSABLE.iter().enumerate() {
        let path = texts.path(&format!("settings-{index}.toml"));
        fs::write(&path, text).unwrap();
        let mut told = told.to_vec();
        told.push(".toml");
        cases.push(refused(
            format!("refine image.png --prior-depth depth.npy --config {}", path.display()),
            &told,
        ));
    }
    check(&cases);
}

#[test]
pub(crate) fn unusable_calibrations() {
    let of = |file: &str| format!("refine image.png --prior-depth depth.npy --calibration {file}");
    check(&[
        refused(of("none.toml"), &["none.toml", "check the path"]),
        refused(of("folder.png"), &["folder.png"]),
        refused(of("broken.toml"), &["broken.toml", "calibrate again"]),
        refused(of("binary.toml"), &["binary.toml", "UTF-8"]),
        refused("calibrate --dataset rooms --method guided", &["--method guided", "no sigma of its own"]),
        refused("calibrate --dataset rooms --method none.toml", &["none.toml"]),
        refused("calibrate good-set --simulated-model all", &["--simulated-model", "--dataset rooms"]),
        refused("calibrate", &["--dataset rooms"]),
        misused(
            "refine image.png --prior-depth depth.npy --interval 1.0 -o out",
            &["--interval", "0.01 to 0.99"],
        ),
        misused(
            "refine image.png --prior-depth depth.npy --interval nan -o out",
            &["--interval", "0.01 to 0.99"],
        ),
        misused("eval --dataset rooms --simulated-model bent -o out", &["bent", "shared"]),
        misused(
            "eval --dataset rooms --simulated-model own --simulated-prior -o out",
            &["cannot be used with"],
        ),
    ]);
}

#[test]
pub(crate) fn unreadable_settings() {
    let of = |file: &str| format!("refine image.png --prior-depth depth.npy --config {file}");
    check(&[
        refused(of("none.toml"), &["none.toml", "check the path"]),
        refused(of("folder.png"), &["folder.png", "not a folder"]),
        refused(of("broken.toml"), &["broken.toml", "seed"]),
        refused(of("binary.toml"), &["binary.toml", "UTF-8"]),
        refused(of("depth.npy"), &["depth.npy", "UTF-8"]),
        refused(
            "refine image.png --prior-depth depth.npy --near 3 --far 2",
            &["--near, --far", "disparity.far is 2"],
        ),
        refused("demo --size 64x48 --config broken.toml", &["broken.toml", "seed"]),
        refused("warp image.png --prior-depth depth.npy --config none.toml", &["none.toml"]),
        refused("ablate --dataset rooms --config none.toml", &["none.toml"]),
    ]);
}
