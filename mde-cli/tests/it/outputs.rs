//! The files of a run: maps that agree with each other and with the record, in any number of threads, at any size.

use crate::common::{HEIGHT, Place, REFINE, WIDTH, fixture, names, tiny};
use mde_cli::mde_prior::format::{ReadOptions, read_depth, write_depth, write_npy};
use mde_cli::{Config, Preset};
use ndarray::Array2;
use serde_json::Value;

const OUTPUTS: &str = "confidence.png config.toml depth.npy depth.png image.png preview.png prior.npy report.html run.json sigma.npy";

const KEPT: &str = "refine image.png --prior-depth depth.npy --fov 60 --no-nerf";

/// The maps agree with each other and with the record.
fn check_outputs(place: &Place, folder: &str, size: (usize, usize)) -> Value {
    let [depth, sigma, prior] =
        ["depth", "sigma", "prior"].map(|map| place.map(&format!("{folder}/{map}.npy")));
    assert_eq!([depth.dim(), sigma.dim(), prior.dim()], [size; 3]);
    for (d, s) in depth.iter().zip(&sigma) {
        assert!(*d >= 0.0 && d.is_finite() && *s >= 0.0, "{d} {s}");
        assert_eq!(*d == 0.0, s.is_infinite());
    }
    let record = place.record(folder);
    let scale = record["png_scale"].as_f64().unwrap();
    // The file has its own scale.
    let png = read_depth(place.path(folder).join("depth.png"), &ReadOptions::default()).unwrap();
    for (png, depth) in png.iter().zip(&depth) {
        assert!(f64::from((png - depth).abs()) <= 0.5001 / scale + 1e-6 * f64::from(*depth), "{png} {depth}");
    }
    let text = place.text(&format!("{folder}/config.toml"));
    let config = Config::with_overrides(Preset::Default, &text, "config.toml").unwrap();
    let iterations = record["iterations"].as_array().unwrap();
    assert_eq!(iterations.len(), config.refinement.iterations);
    for iteration in iterations {
        for key in [
            "fusion/a",
            "fusion/b",
            "fusion/sigma_o",
            "fusion/variance_quantiles",
            "warp/mean_hole_fraction",
            "fit/psnr",
            "fit/loss",
            "seconds/warp",
            "seconds/fit",
            "seconds/render",
            "seconds/fuse",
        ] {
            assert!(!iteration.pointer(&format!("/{key}")).unwrap().is_null(), "{key}");
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
    let [said, told] = place.told(demo, 0);
    assert!(said.contains("AbsRel") && said.contains("a/demo"), "{said}");
    assert!(told.contains("iteration 2/2: fuse"), "{told}");
    let record = check_outputs(&place, "a/demo", (HEIGHT, WIDTH));
    assert_eq!(names(&place.path("a")), ["demo"]);
    assert_eq!(names(&place.path("a/demo")).join(" "), OUTPUTS.replace("image", "gt.npy image"));
    assert_eq!((record["seed"].as_u64(), record["camera"]["source"].as_str()), (Some(3), Some("scene")));
    for alignment in ["median", "ls-disparity"] {
        for which in ["prior", "refined"] {
            let scores = &record["scores"]["by_alignment"][alignment][which];
            assert!(scores["abs_rel"].as_f64().unwrap() > 0.0, "{scores}");
        }
    }
    assert_ne!(place.bytes("a/demo/prior.npy"), place.bytes("a/demo/gt.npy"));
}

/// `depth.png` is millimetres whatever it holds, and goes back into the program with its unit.
#[test]
fn a_depth_png_is_read_back_in_its_unit() {
    let place = Place::new();
    let refine = |prior: &str, out: &str| {
        let told = place.run(&KEPT.replace("depth.npy", &format!("{prior} -o {out}")));
        (told, place.record(out), place.map(&format!("{out}/prior.npy")))
    };
    let near = |a: &Array2<f32>, b: &Array2<f32>| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 5.1e-4);
    let (_, record, written) = refine("depth.npy", "a");
    assert_eq!(record["png_scale"], 1000.0);
    let (_, record, read) = refine("a/depth.png", "b");
    assert!(
        near(&written, &read) && record["unit"] == "m" && record["prior"]["kind"] == "metric",
        "{record}"
    );
    // Of unknown scale once, of unknown scale again, with a word.
    let (_, _, written) = refine("depth.npy --prior-kind depth", "c");
    let (warned, record, read) = refine("c/depth.png", "d");
    assert!(warned.contains("c/depth.png: its metadata have the unit \"unscaled\""), "{warned}");
    assert!(near(&written, &read) && record["unit"] == "unscaled");
    // Far pixels are missing, and counted.
    let truth = &place.scene.depth;
    write_npy(place.path("far.npy"), truth.mapv(|z| if z > 3.0 { 80.0 } else { z }).view()).unwrap();
    let (warned, record, _) = refine("far.npy", "e");
    let far = truth.iter().filter(|z| **z > 3.0).count();
    assert!(far > 0 && warned.contains(&format!("{far} pixels are farther than the 65.535 m")), "{warned}");
    assert_eq!(record["png_missing_pixels"], far);
    let confidence = "refine image.png --prior-depth a/confidence.png --fov 60 -o out";
    place.refused(confidence, &["a confidence, not a depth"]);
}

/// Nor does it depend on the number of threads, by the flag or the variable, or on whether it ran before.
#[test]
fn a_refinement_does_not_depend_on_threads_or_on_the_prior_format() {
    let place = Place::new();
    for name in ["depth.pfm", "depth.exr", "depth.npz"] {
        write_depth(place.path(name), place.scene.depth.view()).unwrap();
    }
    place.take(fixture("grey_nchw.onnx"), "grey.onnx");
    // Rows that no number of threads divides.
    let odd = tiny(&[("rays = 128", "rays = 131"), ("steps = 60", "steps = 20")]);
    let grids = "kind = 'hash'\nlevels = 4\nlog2-rows = 10\nfinest = 64\nwidth = 16";
    place.write("mlp.toml", odd.replace(grids, "kind = 'mlp'\nlayers = 2\nwidth = 16"));
    place.write("tiny.toml", odd);
    let map = "--prior-depth depth.npy --config";
    let network = "--prior-model grey.onnx --model-profile fastdepth --predictions 5";
    let threads: &[&str] = &["--threads 1", "--threads 5", "RAYON_NUM_THREADS=3"];
    let formats: &[&str] =
        &["", "", "--prior-depth depth.pfm", "--prior-depth depth.exr", "--prior-depth depth.npz"];
    let mut runs = vec![
        (format!("{map} tiny.toml --preset default"), threads),
        (format!("{map} tiny.toml --preset fast"), threads),
        (format!("{map} tiny.toml --preset paper"), threads),
        (format!("{map} mlp.toml --preset paper"), threads),
        (format!("{map} tiny.toml"), formats),
    ];
    if cfg!(feature = "onnx") {
        runs.push((network.to_owned(), threads));
    }
    for (rest, variants) in runs {
        let mut first = None;
        for variant in variants {
            let flag = variant.split_once('=').map_or(*variant, |_| "");
            let rest = if flag.contains("prior") {
                rest.replace("--prior-depth depth.npy", flag)
            } else {
                format!("{rest} {flag}")
            };
            let mut command = place.mde(&format!("refine image.png {rest} --fov 60 -q --force -o same"));
            command.env_remove("RAYON_NUM_THREADS");
            variant.split_once('=').map(|(name, value)| command.env(name, value));
            command.assert().success().stdout("").stderr("");
            let maps = ["depth", "sigma", "prior"].map(|map| place.bytes(&format!("same/{map}.npy")));
            assert!(maps[0] != maps[2], "{rest}: the result is the prior");
            assert!(*first.get_or_insert_with(|| maps.clone()) == maps, "{rest} {variant}");
        }
        // Without a field the network's run has no iterations, whatever its settings.
        if rest.starts_with(map) {
            check_outputs(&place, "same", (HEIGHT, WIDTH));
        }
    }
}

#[test]
fn an_unknown_camera_is_warned_of_and_json_lines_are_json() {
    let place = Place::new();
    let [said, told] = place.told(
        "refine image.png --prior-depth depth.npy --prior-kind depth --gt depth.npy --config tiny.toml --log-json -o out",
        0,
    );
    assert_eq!(said, "");
    let lines: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let events = |name: &str| lines.iter().filter(|line| line["event"] == name).count();
    assert_eq!((events("warning") > 0, events("done")), (true, 1));
    assert!(events("fit") > 0 && events("render") > 0 && events("begin") > 5);
    let record = check_outputs(&place, "out", (HEIGHT, WIDTH));
    assert!(record["warnings"][0].as_str().unwrap().contains("60 degrees"));
    assert_eq!(record["camera"]["source"]["assumed"].as_f64(), Some(60.0));
    assert_eq!(record["prior"]["kind"], "depth");
    assert!(record["scores"]["by_alignment"]["median"]["refined"]["nll"].is_f64());
}

#[test]
fn files_for_other_programs_are_written_where_asked_for_and_a_field_is_rendered() {
    let place = Place::new();
    place.run(&format!("{REFINE} -q --export field,ply,exr,colmap,glb,transforms -o out"));
    let mut exported = names(&place.path("out"));
    exported.retain(|name| !OUTPUTS.contains(name.as_str()));
    let all = ["cloud.ply", "colmap", "depth.exr", "field.safetensors", "mesh.glb", "transforms.json"];
    assert_eq!(exported, all);
    assert_eq!(names(&place.path("out/colmap/sparse/0")), ["cameras.txt", "images.txt", "points3D.txt"]);
    assert_eq!(names(&place.path("out/colmap/images")), ["image.png"]);
    let render = |rest: &str| {
        place.run(&format!("render --field out/field.safetensors --size 32x24 --fov 60 {rest}"));
    };
    render("-o still");
    let depth = place.map("still/depth.npy");
    assert!(depth.dim() == (24, 32) && depth.iter().any(|d| *d > 0.0));
    render("--orbit 2 -o orbit");
    assert!(place.has("orbit/colour_001.png"));
    render("--translate -0.1,0,0.05 -o moved");
    // The camera steps left, so the world moves right.
    assert_eq!(place.record("moved")["views"][0]["world_to_camera"][0][3].as_f64(), Some(0.1));
    // A fuzz target whose seeds are refused for their version never gets further. The crate's package has no such folder.
    let seeds = concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/seeds/saved_field");
    for (index, entry) in std::fs::read_dir(seeds).into_iter().flatten().enumerate() {
        let seed = entry.unwrap().path();
        place.run(&format!("render --field {} --size 8x8 --fov 60 -q -o seed{index}", seed.display()));
    }
}

#[test]
fn warped_views_come_with_masks_depths_and_poses() {
    let place = Place::new();
    let warp = "warp image.png --prior-depth depth.npy --fov 60 --config tiny.toml -o views";
    let [said, _] = place.told(warp, 0);
    assert!(said.contains("3 views"), "{said}");
    for name in ["view_00.png", "view_03.png", "mask_03.png", "depth_03.npy", "contact.png", "run.json"] {
        assert!(place.has(&format!("views/{name}")), "{name}");
    }
    let poses = place.json("views/poses.json");
    assert_eq!((poses.as_array().unwrap().len(), poses[0]["trainable"].as_f64()), (4, Some(1.0)));
    assert!((0.5..1.0).contains(&poses[1]["trainable"].as_f64().unwrap()));
}

#[test]
fn a_printed_preset_is_a_configuration() {
    let place = Place::new();
    for preset in Preset::ALL {
        let [text, _] = place.told(&format!("config --preset {}", preset.name()), 0);
        assert_eq!(Config::with_overrides(Preset::Paper, &text, "stdout").unwrap(), preset.config());
    }
}

#[test]
fn an_output_has_a_name_without_o() {
    let place = Place::new();
    place.run(&format!("{KEPT} -q"));
    place.run("eval --dataset rooms --size 64x48 --limit 1 --methods guided -q");
    let told = "image-depth: the folder exists; give another name to -o";
    place.refused(&format!("{KEPT} -q"), &[told]);
    assert!(place.has("image-depth") && place.has("rooms-eval"));
}

/// A photograph above the work size is refined smaller, and its maps have its own size again.
#[test]
fn a_large_photograph_is_refined_at_the_work_size() {
    let place = Place::new();
    let run = |out: &str, rest: &str| {
        place
            .run(&format!("refine image.png --prior-depth depth.npy --fov 60 --preset fast -o {out} {rest}"));
        let warnings = check_outputs(&place, out, (HEIGHT, WIDTH))["warnings"].to_string();
        (warnings.contains("--work-size"), place.map(&format!("{out}/depth.npy")))
    };
    let ((large, own), (small, reduced)) = (run("own", ""), run("small", "--work-size 0.0005"));
    assert!(!large && small);
    let off = own.iter().zip(&reduced).map(|(a, b)| f64::from((a / b).ln().abs())).sum::<f64>();
    let off = off / own.len() as f64;
    assert!(off > 0.0 && off < 0.05, "{off}");
}

/// A disparity map of unknown scale and shift is brought to metres by twenty known depths.
#[test]
fn known_depths_give_the_scale() {
    let place = Place::new();
    let truth = &place.scene.depth;
    write_npy(place.path("disparity.npy"), truth.mapv(|z| 3.0 / z + 0.4).view()).unwrap();
    let rows: Vec<String> =
        truth.indexed_iter().step_by(157).map(|((y, x), z)| format!("{x},{y},{z}")).collect();
    place.write("known.csv", format!("x,y,depth\n{}\n", rows.join("\n")));
    let refine = KEPT.replace("depth.npy", "disparity.npy --prior-kind disparity");
    place.run(&format!("{refine} -o assumed"));
    place.run(&format!("{refine} --scale-from known.csv --export sigma -o scaled"));
    let error = |out: &str| {
        let depth = place.map(&format!("{out}/depth.npy"));
        let mut off: Vec<f32> = depth.iter().zip(truth).map(|(a, b)| (a / b - 1.0).abs()).collect();
        off.sort_by(f32::total_cmp);
        off[off.len() / 2]
    };
    assert!(error("assumed") > 0.05 && error("scaled") < 0.01, "{} {}", error("assumed"), error("scaled"));
    let record = place.record("scaled");
    assert!(record["unit"] == "m" && record["scale"]["points"] == rows.len(), "{record}");
    let (sigma, scale) = (place.map("scaled/sigma.npy"), place.map("scaled/sigma/scale.npy"));
    assert!(scale.iter().zip(&sigma).all(|(part, whole)| *part > 0.0 && part <= whole));
}

/// A network's own camera takes the place of an assumed one, and its own error is exported.
#[cfg(feature = "onnx")]
#[test]
fn a_networks_camera_and_error_are_used() {
    let place = Place::new();
    place.take(fixture("unidepth.onnx"), "net.onnx");
    let refine = "refine image.png --prior-model net.onnx --runtime tract --export sigma";
    let [said, _] = place.told(&format!("{refine} -o own"), 0);
    place.run(&format!("{refine} --fov 60 -o given"));
    let (own, given) = (place.record("own"), place.record("given"));
    assert!(own["camera"]["source"] == "network" && given["camera"]["source"]["field-of-view"] == 60.0);
    // 30 pixels at its input's 42 are as many at the photograph's width.
    let focal = 30.0 * WIDTH as f64 / 42.0;
    assert!((own["camera"]["fx"].as_f64().unwrap() / focal - 1.0).abs() < 1e-6, "{}", own["camera"]);
    assert_eq!(place.map("own/sigma/network-error.npy").dim(), (HEIGHT, WIDTH));
    // The plan and its reason, where the settings are kept.
    let settings = place.text("own/config.toml");
    let plan = &own["augmentation"];
    let first = format!("# {} predictions: {}", plan["predictions"], plan["reason"].as_str().unwrap());
    assert!(settings.starts_with(&first), "{settings}");
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        said.contains("12 % of the depth is FastDepth's error") && said.contains("mde calibrate"),
        "{said}"
    );
    assert_eq!(own["error_bar"]["common_assumed"], 0.12);
    // The scale's error is known for the network of a calibration alone.
    assert!(own["error_bar"]["scale"].is_null() && own["error_bar"]["common_by"].is_null());
}
