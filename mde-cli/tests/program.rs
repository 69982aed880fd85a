//! The program's outputs.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, WIDTH, names};
use mde_cli::config::{Config, Preset};
use mde_cli::mde_prior::format::{ReadOptions, read_depth, read_values, write_depth, write_npy};
use ndarray::Array2;
use ndarray_npy::read_npy;
use predicates::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;

const OUTPUTS: [&str; 10] = [
    "confidence.png",
    "config.toml",
    "depth.npy",
    "depth.png",
    "image.png",
    "preview.png",
    "prior.npy",
    "report.html",
    "run.json",
    "sigma.npy",
];

fn record(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("run.json")).unwrap()).unwrap()
}

/// The maps agree with each other and with the record.
fn check_outputs(folder: &Path, (height, width): (usize, usize)) -> Value {
    let map = |name: &str| -> Array2<f32> { read_npy(folder.join(name)).unwrap() };
    let (depth, sigma, prior) = (map("depth.npy"), map("sigma.npy"), map("prior.npy"));
    for map in [&depth, &sigma, &prior] {
        assert_eq!(map.dim(), (height, width));
    }
    for (d, s) in depth.iter().zip(&sigma) {
        assert!(*d >= 0.0 && d.is_finite() && *s >= 0.0, "{d} {s}");
        assert_eq!(*d == 0.0, s.is_infinite());
    }
    let record = record(folder);
    let scale = record["png_scale"].as_f64().unwrap();
    // The file has its own scale.
    let png = read_depth(folder.join("depth.png"), &ReadOptions::default()).unwrap();
    for (png, depth) in png.iter().zip(&depth) {
        assert!(f64::from((png - depth).abs()) <= 0.5001 / scale + 1e-6 * f64::from(*depth), "{png} {depth}");
    }
    let text = fs::read_to_string(folder.join("config.toml")).unwrap();
    let config = Config::with_overrides(Preset::Default, &text, "config.toml").unwrap();
    let iterations = record["iterations"].as_array().unwrap();
    assert_eq!(iterations.len(), config.refinement.iterations);
    for iteration in iterations {
        for (group, keys) in [
            ("fusion", &["a", "b", "sigma_o", "variance_quantiles"][..]),
            ("warp", &["mean_hole_fraction"]),
            ("fit", &["psnr", "loss"]),
            ("seconds", &["warp", "fit", "render", "fuse"]),
        ] {
            for key in keys {
                assert!(!iteration[group][key].is_null(), "{group}.{key}");
            }
        }
    }
    assert_eq!(record["versions"].as_object().unwrap().len(), 8);
    assert!(record["total_seconds"].as_f64().unwrap() > 0.0);
    assert!(!cfg!(target_os = "linux") || record["peak_memory_bytes"].as_u64().unwrap() > 1 << 20);
    record
}

#[test]
fn the_demo_of_one_photograph_is_scored_against_its_exact_depth() {
    let place = Place::new();
    let demo = "demo --preset default --size 64x48 --config tiny.toml --seed 3 -o a/demo";
    let run = place.mde(demo).assert().success();
    run.stdout(predicate::str::contains("AbsRel").and(predicate::str::contains("a/demo")))
        .stderr(predicate::str::contains("iteration 2/2: fuse"));
    let record = check_outputs(&place.path("a/demo"), (HEIGHT, WIDTH));
    assert_eq!(names(&place.path("a")), ["demo"]);
    let mut expected = [&OUTPUTS[..], &["gt.npy"]].concat();
    expected.sort_unstable();
    assert_eq!(names(&place.path("a/demo")), expected);
    assert_eq!((record["seed"].as_u64(), record["camera"]["source"].as_str()), (Some(3), Some("scene")));
    for alignment in ["median", "ls-disparity"] {
        for which in ["prior", "refined"] {
            let scores = &record["scores"]["by_alignment"][alignment][which];
            assert!(scores["abs_rel"].as_f64().unwrap() > 0.0, "{scores}");
        }
    }
    // The simulated prior is no copy of the truth.
    assert_ne!(
        fs::read(place.path("a/demo/prior.npy")).unwrap(),
        fs::read(place.path("a/demo/gt.npy")).unwrap()
    );
}

/// `depth.png` is millimetres whatever it holds, and goes back into the program with its unit.
#[test]
fn a_depth_png_is_read_back_in_its_unit() {
    let place = Place::new();
    let refine = |prior: &str, out: &str| {
        let kind =
            format!("refine image.png --prior-depth {prior} --fov 60 --config tiny.toml --no-nerf -o {out}");
        let run = place.mde(&kind).assert().success();
        String::from_utf8(run.get_output().stderr.clone()).unwrap()
    };
    let prior = |out: &str| -> Array2<f32> { read_npy(place.path(&format!("{out}/prior.npy"))).unwrap() };
    let near = |a: &Array2<f32>, b: &Array2<f32>| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 5.1e-4);
    refine("depth.npy", "a");
    assert_eq!(record(&place.path("a"))["png_scale"], 1000.0);
    refine("a/depth.png", "b");
    assert!(near(&prior("a"), &prior("b")));
    assert_eq!(
        (&record(&place.path("b"))["unit"], &record(&place.path("b"))["prior"]["kind"]),
        (&"m".into(), &"metric".into())
    );
    // Of unknown scale once, of unknown scale again, with a word.
    refine("depth.npy --prior-kind depth", "c");
    let warned = refine("c/depth.png", "d");
    assert!(warned.contains("c/depth.png: its metadata have the unit \"unscaled\""), "{warned}");
    assert!(near(&prior("c"), &prior("d")));
    assert_eq!(record(&place.path("d"))["unit"], "unscaled");
    // Far pixels are missing, and counted.
    write_npy(place.path("far.npy"), place.scene.depth.mapv(|z| if z > 3.0 { 80.0 } else { z }).view())
        .unwrap();
    let warned = refine("far.npy", "e");
    let far = place.scene.depth.iter().filter(|z| **z > 3.0).count();
    assert!(far > 0 && warned.contains(&format!("{far} pixels are farther than the 65.535 m")), "{warned}");
    assert_eq!(record(&place.path("e"))["png_missing_pixels"], far);
    let refused = place.mde("refine image.png --prior-depth a/confidence.png --fov 60 -o f").assert().code(1);
    refused.stderr(predicate::str::contains("a confidence, not a depth"));
}

#[test]
fn a_refinement_does_not_depend_on_threads_or_on_the_prior_format() {
    let place = Place::new();
    for name in ["depth.pfm", "depth.exr", "depth.npz"] {
        write_depth(place.path(name), place.scene.depth.view(), &Default::default()).unwrap();
    }
    let mut results = Vec::new();
    for (index, prior) in
        ["depth.npy --threads 1", "depth.npy --threads 2", "depth.pfm", "depth.exr", "depth.npz"]
            .into_iter()
            .enumerate()
    {
        let arguments = format!(
            "refine image.png --prior-depth {prior} --fov 60 --config tiny.toml -o out{index} --quiet"
        );
        place.mde(&arguments).assert().success().stderr("").stdout("");
        let folder = place.path(&format!("out{index}"));
        check_outputs(&folder, (HEIGHT, WIDTH));
        results
            .push((fs::read(folder.join("depth.npy")).unwrap(), fs::read(folder.join("sigma.npy")).unwrap()));
    }
    assert!(results.iter().all(|result| result == &results[0]));
    assert_eq!(names(&place.path("out0")), OUTPUTS);
}

#[test]
fn another_seed_gives_another_result_and_force_replaces_it() {
    let place = Place::new();
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --quiet -o out";
    place.mde(&format!("{refine} --seed 1")).assert().success();
    let first = fs::read(place.path("out/depth.npy")).unwrap();
    place.mde(&format!("{refine} --seed 2")).assert().code(1);
    assert!(fs::read(place.path("out/depth.npy")).unwrap() == first);
    place.write("out/notes.txt", "old");
    place.mde(&format!("{refine} --seed 2 --force")).assert().success();
    assert!(fs::read(place.path("out/depth.npy")).unwrap() != first);
    assert_eq!(names(&place.path("out")), OUTPUTS);
}

#[test]
fn an_unknown_camera_is_warned_of_and_json_lines_are_json() {
    let place = Place::new();
    let arguments = "refine image.png --prior-depth depth.npy --prior-kind depth --gt depth.npy --config tiny.toml \
                     --log-json -o out";
    let run = place.mde(arguments).assert().success().stdout("");
    let text = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let events = |name: &str| lines.iter().filter(|line| line["event"] == name).count();
    assert_eq!((events("warning") > 0, events("done")), (true, 1));
    assert!(events("fit") > 0 && events("render") > 0 && events("begin") > 5);
    let record = check_outputs(&place.path("out"), (HEIGHT, WIDTH));
    assert!(record["warnings"][0].as_str().unwrap().contains("60 degrees"));
    assert_eq!(record["camera"]["source"]["assumed"].as_f64(), Some(60.0));
    assert_eq!(record["prior"]["kind"], "depth");
    assert!(record["scores"]["by_alignment"]["median"]["refined"]["nll"].is_f64());
}

#[test]
fn a_saved_field_is_rendered() {
    let place = Place::new();
    place
        .mde("refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --save-field -q -o out")
        .assert()
        .success();
    let render =
        |rest: &str| place.mde(&format!("render --field out/field.safetensors {rest}")).assert().success();
    render("--size 32x24 --fov 60 -o still");
    let depth: Array2<f32> = read_npy(place.path("still/depth.npy")).unwrap();
    assert_eq!(depth.dim(), (24, 32));
    assert!(depth.iter().any(|d| *d > 0.0));
    render("--size 32x24 --fov 60 --orbit 2 -o orbit");
    assert!(names(&place.path("orbit")).contains(&"colour_001.png".to_owned()));
    render("--size 32x24 --fov 60 --translate -0.1,0,0.05 -o moved");
    let moved = record(&place.path("moved"));
    // The camera steps left, so the world moves right.
    assert_eq!(moved["views"][0]["world_to_camera"][0][3].as_f64(), Some(0.1));
}

#[test]
fn a_saved_field_of_another_version_or_damaged_is_refused() {
    let place = Place::new();
    place
        .mde("refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml --save-field -q -o out")
        .assert()
        .success();
    let whole = fs::read(place.path("out/field.safetensors")).unwrap();
    let version = br#"version\":"#;
    let at = whole.windows(version.len()).position(|bytes| bytes == version).unwrap() + version.len();
    let with = |place: usize, value: u8| {
        let mut bytes = whole.clone();
        bytes[place] = value;
        bytes
    };
    let last = whole.len() - 1;
    // A render from another scale or unit would be wrong without a sign of it.
    let seed = br#"seed\":"#;
    let seed = whole.windows(seed.len()).position(|bytes| bytes == seed).unwrap() + seed.len();
    for (bytes, told) in [
        (with(at, b'9'), "version is 9"),
        (with(seed, b'7'), "checksum of its header"),
        (with(last, whole[last] ^ 1), "checksum"),
        (whole[..last].to_vec(), "not a usable field"),
        (whole[..40].to_vec(), "not a usable field"),
    ] {
        place.write("field.safetensors", bytes);
        let run =
            place.mde("render --field field.safetensors --size 32x24 --fov 60 -q -o still").assert().code(1);
        let message = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert!(message.contains("field.safetensors") && message.contains(told), "{message}");
        assert!(message.lines().count() == 1 && !place.path("still").exists(), "{message}");
    }
}

#[test]
fn warped_views_come_with_masks_depths_and_poses() {
    let place = Place::new();
    let run =
        place.mde("warp image.png --prior-depth depth.npy --fov 60 --config tiny.toml -o views").assert();
    run.success().stdout(predicate::str::contains("3 views"));
    let views = names(&place.path("views"));
    for name in
        ["view_00.png", "view_03.png", "mask_03.png", "depth_03.npy", "poses.json", "contact.png", "run.json"]
    {
        assert!(views.contains(&name.to_owned()), "{name}");
    }
    let poses: Value =
        serde_json::from_str(&fs::read_to_string(place.path("views/poses.json")).unwrap()).unwrap();
    assert_eq!(poses.as_array().unwrap().len(), 4);
    assert_eq!(poses[0]["trainable"].as_f64(), Some(1.0));
    assert!((0.5..1.0).contains(&poses[1]["trainable"].as_f64().unwrap()));
}

#[test]
fn a_printed_preset_is_a_configuration() {
    let place = Place::new();
    for preset in Preset::ALL {
        let run = place.mde(&format!("config --preset {}", preset.name())).assert().success();
        let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
        assert_eq!(Config::with_overrides(Preset::Paper, &text, "stdout").unwrap(), preset.config());
    }
    place.mde("--version").assert().success().stdout(predicate::str::contains(env!("CARGO_PKG_VERSION")));
    place.mde("--help").assert().success().stdout(predicate::str::contains("130"));
    place.mde("refine --help").assert().success().stdout(predicate::str::contains("Examples"));
}

#[test]
#[cfg(unix)]
fn an_interrupted_run_stops_soon_and_leaves_nothing() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    let place = Place::new();
    place.write("long.toml", common::TINY.replace("steps = 60", "steps = 1000000"));
    let before = place.entries();
    for signal in ["INT", "TERM"] {
        let mut run = Command::new(env!("CARGO_BIN_EXE_mde"))
            .current_dir(place.path("."))
            .args(
                "refine image.png --prior-depth depth.npy --fov 60 --config long.toml -o a/b/out".split(' '),
            )
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(run.stderr.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains("fit")));
        let start = Instant::now();
        let kill = format!("kill -{signal} {}", run.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        assert_eq!(run.wait().unwrap().code(), Some(130));
        assert!(start.elapsed() < Duration::from_secs(60));
        assert!(lines.any(|line| line.contains("interrupted")));
        assert_eq!(place.entries(), before);
    }
}

#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn a_real_scene_is_refined_with_a_real_model() {
    let shared = common::shared();
    let place = Place::new();
    let scene = shared.join("data/SUNRGBD/kv1/img_0063");
    let short = "[nerf.train]\nsteps = 20\nrays = 256\n[nerf.render]\ncoarse = 4\nfine = 4\n";
    place.write("short.toml", short);
    let run = place
        .mde("refine --preset fast --config short.toml --gt-encoding sunrgbd --intrinsics-base 1 -o out")
        .arg(scene.join("image/img_0063.jpg"))
        .arg("--prior-model")
        .arg(shared.join("models/fastdepth/fastdepth_224.onnx"))
        .arg("--intrinsics")
        .arg(scene.join("intrinsics.txt"))
        .arg("--gt")
        .arg(scene.join("depth/img_0063.png"))
        .assert()
        .success();
    run.stdout(predicate::str::contains("median alignment"));
    let record = check_outputs(&place.path("out"), (427, 561));
    assert_eq!(record["prior"]["kind"], "metric");
    assert!((record["camera"]["cx"].as_f64().unwrap() - 276.9258).abs() < 1e-9);
    let abs_rel = record["scores"]["by_alignment"]["median"]["prior"]["abs_rel"].as_f64().unwrap();
    assert!((0.02..0.2).contains(&abs_rel), "{abs_rel}");
}

#[test]
fn an_output_has_a_name_without_o() {
    let place = Place::new();
    place.mde("refine image.png --prior-depth depth.npy --fov 60 --no-nerf -q").assert().success();
    place.mde("eval --dataset rooms --size 64x48 --limit 1 --methods guided -q").assert().success();
    place
        .mde("refine image.png --prior-depth depth.npy --fov 60 --no-nerf -q")
        .assert()
        .code(1)
        .stderr(predicate::str::contains("image-depth: the folder exists; give another name to -o"));
    let names = place.entries();
    assert!(["image-depth", "rooms-eval"].iter().all(|name| names.iter().any(|n| n == name)), "{names:?}");
}

#[test]
fn a_prior_of_another_size_and_one_of_eight_bits_are_taken_with_a_note() {
    let place = Place::new();
    let small = Array2::from_shape_fn((HEIGHT / 2, WIDTH / 2), |(y, x)| place.scene.depth[(2 * y, 2 * x)]);
    write_npy(place.path("small.npy"), small.view()).unwrap();
    let picture =
        image::GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| image::Luma([(2 * x + y) as u8]));
    picture.save(place.path("eight.png")).unwrap();
    let refine = |rest: &str| {
        let run = place.mde(&format!("refine image.png --fov 60 --no-nerf {rest}")).assert().success();
        String::from_utf8(run.get_output().stderr.clone()).unwrap()
    };
    let told = refine("--prior-depth small.npy -o small");
    assert!(told.contains("small.npy: resized from 32x24 to 64x48 pixels"), "{told}");
    let map = read_values(place.path("small/prior.npy"), &ReadOptions::default()).unwrap();
    assert!(map.indexed_iter().all(|((y, x), z)| *z == small[(y / 2, x / 2)]));
    let told = refine("--prior-depth eight.png --prior-kind disparity -o eight");
    assert!(told.contains("eight.png: 8 bits hold 256 levels"), "{told}");
    // As depth in metres it would be a picture of depth.
    place.mde("refine image.png --fov 60 --prior-depth eight.png -o metric").assert().code(1);
}

/// A photograph above the work size is refined smaller, and its maps have its own size again.
#[test]
fn a_large_photograph_is_refined_at_the_work_size() {
    let place = Place::new();
    let run = |out: &str, rest: &str| {
        let command =
            format!("refine image.png --prior-depth depth.npy --fov 60 --preset fast -o {out} {rest}");
        place.mde(&command).assert().success();
        check_outputs(&place.path(out), (HEIGHT, WIDTH))
    };
    let (own, small) = (run("own", ""), run("small", "--work-size 0.0005"));
    let warned = |record: &Value| record["warnings"].to_string().contains("--work-size");
    assert!(!warned(&own) && warned(&small), "{} {}", own["warnings"], small["warnings"]);
    let depth = |out: &str| -> Array2<f32> { read_npy(place.path(out).join("depth.npy")).unwrap() };
    let (own, small) = (depth("own"), depth("small"));
    let off =
        own.iter().zip(&small).map(|(a, b)| f64::from((a / b).ln().abs())).sum::<f64>() / own.len() as f64;
    assert!(off > 0.0 && off < 0.05, "{off}");
}

/// A disparity map of unknown scale and shift is brought to metres by twenty known depths.
#[test]
fn known_depths_give_the_scale() {
    let place = Place::new();
    let truth = &place.scene.depth;
    write_npy(place.path("disparity.npy"), truth.mapv(|z| 3.0 / z + 0.4).view()).unwrap();
    let known = truth.indexed_iter().step_by(157);
    let rows: Vec<String> = known.map(|((y, x), z)| format!("{x},{y},{z}")).collect();
    place.write("known.csv", format!("x,y,depth\n{}\n", rows.join("\n")));
    let refine = "refine image.png --prior-depth disparity.npy --prior-kind disparity --fov 60 --no-nerf";
    place.mde(&format!("{refine} -o assumed")).assert().success();
    place.mde(&format!("{refine} --scale-from known.csv --export sigma -o scaled")).assert().success();
    let error = |out: &str| {
        let depth: Array2<f32> = read_npy(place.path(out).join("depth.npy")).unwrap();
        let mut off: Vec<f32> = depth.iter().zip(truth).map(|(a, b)| (a / b - 1.0).abs()).collect();
        off.sort_by(f32::total_cmp);
        off[off.len() / 2]
    };
    assert!(error("assumed") > 0.05 && error("scaled") < 0.01, "{} {}", error("assumed"), error("scaled"));
    let record = record(&place.path("scaled"));
    assert_eq!((&record["unit"], &record["scale"]["points"]), (&Value::from("m"), &Value::from(rows.len())));
    let sigma: Array2<f32> = read_npy(place.path("scaled/sigma.npy")).unwrap();
    let scale: Array2<f32> = read_npy(place.path("scaled/sigma/scale.npy")).unwrap();
    assert!(scale.iter().zip(&sigma).all(|(part, whole)| *part > 0.0 && part <= whole));
}

/// A network's own camera takes the place of an assumed one, and its own error is exported.
#[cfg(feature = "onnx")]
#[test]
fn a_networks_camera_and_error_are_used() {
    let place = Place::new();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures/unidepth.onnx");
    fs::copy(fixture, place.path("net.onnx")).unwrap();
    let refine = "refine image.png --prior-model net.onnx --runtime tract --export sigma";
    place.mde(&format!("{refine} -o own")).assert().success();
    place.mde(&format!("{refine} --fov 60 -o given")).assert().success();
    let [own, given] = ["own", "given"].map(|out| record(&place.path(out)));
    assert_eq!(
        (&own["camera"]["source"], &given["camera"]["source"]["field-of-view"]),
        (&Value::from("network"), &Value::from(60.0))
    );
    // 30 pixels at its input's 42 are as many at the photograph's width.
    let focal = 30.0 * WIDTH as f64 / 42.0;
    assert!((own["camera"]["fx"].as_f64().unwrap() / focal - 1.0).abs() < 1e-6, "{}", own["camera"]);
    let error: Array2<f32> = read_npy(place.path("own/sigma/network-error.npy")).unwrap();
    assert_eq!(error.dim(), (HEIGHT, WIDTH));
    // The plan and its reason, where the settings are kept.
    let settings = fs::read_to_string(place.path("own/config.toml")).unwrap();
    let plan = &own["augmentation"];
    let first = format!("# {} predictions: {}", plan["predictions"], plan["reason"].as_str().unwrap());
    assert!(settings.starts_with(&first), "{settings}");
    let told = place.mde(&format!("{refine} -o told")).assert().success();
    let told = String::from_utf8_lossy(&told.get_output().stdout).into_owned();
    let told = told.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        told.contains("12 % of the depth is FastDepth's error") && told.contains("mde calibrate"),
        "{told}"
    );
    assert_eq!(own["error_bar"]["common_assumed"], 0.12);
    // The scale's error is known for the network of a calibration alone.
    assert!(own["error_bar"]["scale"].is_null() && own["error_bar"]["common_by"].is_null());
}
