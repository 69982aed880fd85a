//! The files of a run: maps that agree with each other and with the record, its report, its error bars.

use crate::common::{HEIGHT, Place, REFINE, WIDTH, fixture, names, ratios, report_data, shared, tiny};
use mde_cli::Preset;
use mde_cli::mde_prior::format::{ReadOptions, read_depth, write_depth};
use mde_cli::refiner::calibration;
use mde_uncertainty::statistics::median;
use serde_json::{Value, json};
use std::fs;

const OUTPUTS: &str = "confidence.png config.toml depth.npy depth.png image.png preview.png prior.npy report.html run.json sigma.npy thumbnail.png";
const LEARN: &str = "calibrate --dataset rooms --size 64x48 --limit 3 --simulated model -o learned";
const KEPT: &str = "refine image.png --prior-depth depth.npy --fov 60 --no-nerf";

fn check_outputs(place: &Place, folder: &str) -> Value {
    let [depth, sigma, prior] =
        ["depth", "sigma", "prior"].map(|map| place.map(&format!("{folder}/{map}.npy")));
    assert_eq!([depth.dim(), sigma.dim(), prior.dim()], [(HEIGHT, WIDTH); 3]);
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
    let config = Preset::Default.config().with_text(&text, "config.toml").unwrap();
    let iterations = record["iterations"].as_array().unwrap();
    assert_eq!(iterations.len(), config.refinement.iterations);
    for iteration in iterations {
        let keys = "fusion/a fusion/b fusion/sigma_o fusion/variance_quantiles warp/mean_hole_fraction \
                    fit/psnr fit/loss seconds/warp seconds/fit seconds/render seconds/fuse";
        for key in keys.split(' ') {
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
    place.prints(demo, 0, "AbsRel ; a/demo ; iteration 2/2: fuse");
    let record = check_outputs(&place, "a/demo");
    assert_eq!(names(&place.path("a")), ["demo"]);
    assert_eq!(names(&place.path("a/demo")).join(" "), OUTPUTS.replace("image", "gt.npy image"));
    assert_eq!((record["seed"].as_u64(), record["camera"]["source"].as_str()), (Some(3), Some("scene")));
    for path in ["median-ratio/prior", "median-ratio/refined", "ls-disparity/prior", "ls-disparity/refined"] {
        let score = record["scores"]["by_alignment"].pointer(&format!("/{path}/abs_rel")).unwrap();
        assert!(score.as_f64().unwrap() > 0.0, "{path}");
    }
    assert_ne!(place.bytes("a/demo/prior.npy"), place.bytes("a/demo/gt.npy"));
}

/// `depth.png` is millimetres whatever it holds, and goes back into the program with its unit.
#[test]
fn a_depth_png_is_read_back_in_its_unit() {
    let place = Place::new();
    let truth = &place.scene.depth;
    place.save("far.npy", &truth.mapv(|z| if z > 3.0 { 80.0 } else { z }));
    let far = truth.iter().filter(|z| **z > 3.0).count();
    assert!(far > 0);
    // Of unknown scale once, of unknown scale again, with a word; far pixels are missing, and counted.
    for (prior, out, unit, warning, missing) in [
        ("depth.npy", "a", "m", "", 0),
        ("a/depth.png", "b", "m", "", 0),
        ("depth.npy --prior-kind depth", "c", "unscaled", "", 0),
        ("c/depth.png", "d", "unscaled", "c/depth.png: its metadata have the unit \"unscaled\"", 0),
        ("far.npy", "e", "m", &*format!("{far} pixels are farther than the 65.535 m"), far),
    ] {
        let warned = place.run(&KEPT.replace("depth.npy", &format!("{prior} -o {out}")));
        let record = place.record(out);
        assert!(warned.contains(warning) && record["unit"] == unit, "{prior}: {warned} {record}");
        assert_eq!((&record["png_scale"], &record["png_missing_pixels"]), (&1000.0.into(), &missing.into()));
    }
    assert_eq!(place.record("b")["prior"]["kind"], "metric");
    for [written, read] in [["a", "b"], ["c", "d"]] {
        let [written, read] = [written, read].map(|out| place.map(&format!("{out}/prior.npy")));
        assert!(written.iter().zip(&read).all(|(a, b)| (a - b).abs() <= 5.1e-4));
    }
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
    let odd = tiny(20, 2).replace("rays = 128", "rays = 131");
    let grids = "kind = 'hash', levels = 4, log2-rows = 10, finest = 64";
    assert!(odd.contains("131") && odd.contains(grids));
    place.write("mlp.toml", odd.replace(grids, "kind = 'mlp', layers = 2"));
    place.write("tiny.toml", odd);
    for run in [
        "--prior-depth depth.npy --config tiny.toml --preset default",
        "--prior-depth depth.npy --config tiny.toml --preset fast",
        "--prior-depth depth.npy --config tiny.toml --preset paper",
        "--prior-depth depth.npy --config mlp.toml --preset paper",
        #[cfg(feature = "onnx")]
        "--prior-model grey.onnx --model-profile fastdepth --predictions 5",
    ] {
        let mut first = None;
        for (threads, format) in [(1, "npy"), (5, "pfm"), (3, "exr"), (2, "npz")] {
            let run = run.replace("npy", format);
            let mut command = place.mde(&format!("refine image.png {run} --fov 60 -q --force -o same"));
            // By the flag or the variable.
            match threads {
                3 => command.env("RAYON_NUM_THREADS", "3"),
                _ => command.env_remove("RAYON_NUM_THREADS").args(["--threads", &threads.to_string()]),
            };
            command.assert().success().stdout("").stderr("");
            let maps = ["depth", "sigma", "prior"].map(|map| place.bytes(&format!("same/{map}.npy")));
            assert!(maps[0] != maps[2], "{run}: the result is the prior");
            assert!(*first.get_or_insert_with(|| maps.clone()) == maps, "{run} {threads}");
        }
        // Without a field the network's run has no iterations, whatever its settings.
        if run.contains("--config") {
            check_outputs(&place, "same");
        }
    }
}

/// With an unknown camera, and progress as lines of JSON.
#[test]
fn a_run_has_a_report_that_can_be_made_again() {
    let place = Place::new();
    place.take("image.png", "a 'b.png");
    let refine = "refine --preset paper --prior-depth depth.npy --prior-kind depth --config tiny.toml \
                  --gt depth.npy --log-json -o made";
    let run = place.mde(refine).arg("a 'b.png").assert().success().stdout("");
    let told = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    let lines: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let events = |name: &str| lines.iter().filter(|line| line["event"] == name).count();
    assert_eq!((events("warning") > 0, events("done")), (true, 1));
    assert!(events("fit") > 0 && events("render") > 0 && events("begin") > 5);
    let record = check_outputs(&place, "made");
    assert!(record["warnings"][0].as_str().unwrap().contains("60 degrees"));
    assert_eq!(
        (&record["camera"]["source"]["assumed"], &record["prior"]["kind"]),
        (&60.0.into(), &"depth".into())
    );
    assert!(record["scores"]["by_alignment"]["median-ratio"]["refined"]["nll"].is_f64());

    let html = place.text("made/report.html");
    let data = report_data(&html);
    assert!(data["kind"] == "run" && data["title"] == "a 'b.png" && data["size"] == json!([WIDTH, HEIGHT]));
    for map in ["prior", "refined", "sigma", "truth"] {
        assert!(data["maps"][map]["data"].as_str().unwrap().len() > 20, "{map}");
    }
    assert!(data["prior_error"].as_array().unwrap().iter().any(|error| error.as_f64().unwrap() > 0.0));
    let record = &data["record"];
    let told = shlex::split(record["command_line"].as_str().unwrap()).unwrap();
    assert!(told.ends_with(&["-o", "made", "a 'b.png"].map(str::to_owned)), "{told:?}");
    let curves = record["training"].as_array().unwrap();
    assert_eq!(curves.len(), record["iterations"].as_array().unwrap().len());
    for curve in curves {
        let [step, loss, psnr] = ["step", "loss", "psnr"].map(|key| curve[key].as_array().unwrap());
        assert!(step.len() > 1 && step.len() == loss.len() && step.len() == psnr.len());
        assert_eq!(step.last().unwrap().as_u64(), Some(60));
        assert!(psnr.last().unwrap().as_f64() > psnr[0].as_f64());
    }

    let before = names(&place.path("made"));
    fs::remove_file(place.path("made/report.html")).unwrap();
    place.prints("report made", 0, "made/report.html");
    assert!(place.text("made/report.html") == html);
    assert_eq!(names(&place.path("made")), before);

    fs::remove_file(place.path("made/image.png")).unwrap();
    place.refused("report made", "image.png ; run the refinement again");
}

#[test]
fn files_for_other_programs_are_written_where_asked_for_and_a_field_is_rendered() {
    let place = Place::new();
    let told = place
        .run(&format!("{REFINE} --interval 0.5 --export field,ply,exr,colmap,glb,transforms,sigma -o out"));
    let mut exported = names(&place.path("out"));
    exported.retain(|name| OUTPUTS.split(' ').all(|usual| usual != name));
    let all =
        "cloud.ply colmap depth.exr field.safetensors lower.npy mesh.glb sigma transforms.json upper.npy";
    assert_eq!(exported.join(" "), all);
    // An interval without a calibration is normal.
    assert!(told.contains("normal distribution"), "{told}");
    let half_width = place.record("out")["error_bar"]["interval"]["half_width"].as_f64().unwrap();
    assert!((half_width - 0.674_489_75).abs() < 1e-6, "{half_width}");
    assert_eq!(names(&place.path("out/sigma")), ["common.npy", "field.npy"]);
    assert_eq!(place.map("out/sigma/field.npy").dim(), (HEIGHT, WIDTH));
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
    place.prints(warp, 0, "3 views");
    for name in ["view_00.png", "view_03.png", "mask_03.png", "depth_03.npy", "contact.png", "run.json"] {
        assert!(place.has(&format!("views/{name}")), "{name}");
    }
    place.refused("report views", "views ; mde warp ; mde refine");
    let poses = place.json("views/poses.json");
    assert_eq!((poses.as_array().unwrap().len(), poses[0]["trainable"].as_f64()), (4, Some(1.0)));
    assert!((0.5..1.0).contains(&poses[1]["trainable"].as_f64().unwrap()));
}

#[test]
fn a_printed_preset_is_a_configuration() {
    let place = Place::new();
    for preset in Preset::ALL {
        let text = place.run(&format!("config --preset {}", preset.name()));
        assert_eq!(Preset::Paper.config().with_text(&text, "stdout").unwrap(), preset.config());
    }
}

#[test]
fn an_output_has_a_name_without_o() {
    let place = Place::new();
    place.run(&format!("{KEPT} -q"));
    place.run("eval --dataset rooms --size 64x48 --limit 1 --methods guided -q");
    let exists = "image-depth: the folder exists; give another name to -o";
    place.refused(&format!("{KEPT} -q"), exists);
    assert!(place.has("image-depth") && place.has("rooms-eval"));
}

/// A photograph above the work size is refined smaller, and its maps have its own size again.
#[test]
fn a_large_photograph_is_refined_at_the_work_size() {
    let place = Place::new();
    let run = |out: &str, rest: &str| {
        place
            .run(&format!("refine image.png --prior-depth depth.npy --fov 60 --preset fast -o {out} {rest}"));
        let warnings = check_outputs(&place, out)["warnings"].to_string();
        (warnings.contains("--work-size"), place.map(&format!("{out}/depth.npy")))
    };
    let ((large, own), (small, reduced)) = (run("own", ""), run("small", "--work-size 0.0005"));
    assert!(!large && small);
    let off = ratios(own.view(), &reduced).map(|ratio| ratio.ln().abs()).sum::<f64>() / own.len() as f64;
    assert!(off > 0.0 && off < 0.05, "{off}");
}

/// A disparity map of unknown scale and shift is brought to metres by twenty known depths.
#[test]
fn known_depths_give_the_scale() {
    let place = Place::new();
    let truth = &place.scene.depth;
    place.save("disparity.npy", &truth.mapv(|z| 3.0 / z + 0.4));
    let rows: Vec<String> =
        truth.indexed_iter().step_by(157).map(|((y, x), z)| format!("{x},{y},{z}")).collect();
    place.write("known.csv", format!("x,y,depth\n{}\n", rows.join("\n")));
    let refine = KEPT.replace("depth.npy", "disparity.npy --prior-kind disparity");
    place.run(&format!("{refine} -o assumed"));
    place.run(&format!("{refine} --scale-from known.csv --export sigma -o scaled"));
    let error = |out: &str| {
        let depth = place.map(&format!("{out}/depth.npy"));
        median(ratios(depth.view(), truth).map(|ratio| (ratio - 1.0).abs())).unwrap()
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
    let said = place.run(&format!("{refine} -o own"));
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

/// And so the parts of sigma, whose root sum of squares it stays.
#[test]
fn what_was_learned_scales_sigma_and_makes_the_interval() {
    let place = Place::new();
    place.prints(LEARN, 0, "on held-out scenes");
    for file in ["calibration.toml", "scenes.csv", "summary.json", "report.html"] {
        assert!(place.has(&format!("learned/{file}")), "{file}");
    }
    let calibration = calibration::read(&place.path("learned/calibration.toml")).unwrap();
    assert_eq!((calibration.scenes.len(), calibration.held_out.len()), (3, 4));

    place.run(&format!("{REFINE} -o plain"));
    let options = "--calibration learned/calibration.toml --interval 0.8";
    let words = "other settings ; lower.npy and upper.npy: 80 % interval, the depth -+  ; \
                 sigma, by learned/calibration.toml";
    place.prints(&format!("{REFINE} {options} -o scaled"), 0, words);
    let factor = calibration.intervals().unwrap().factor(0.9).unwrap() as f32;
    let half_width = calibration.intervals().unwrap().half_width(0.8).unwrap() as f32;
    let [depth, sigma, lower, upper] =
        ["depth", "sigma", "lower", "upper"].map(|name| place.map(&format!("scaled/{name}.npy")));
    assert_eq!(depth, place.map("plain/depth.npy"));
    for (pixel, before) in place.map("plain/sigma.npy").indexed_iter() {
        assert!((sigma[pixel] / before - factor).abs() < 1e-4 * factor);
        let reach = half_width * before;
        assert!((upper[pixel] - depth[pixel] - reach).abs() < 1e-4 * (depth[pixel] + reach));
        assert!((lower[pixel] - (depth[pixel] - reach).max(0.0)).abs() < 1e-4 * (depth[pixel] + reach));
    }
    let record = place.record("scaled");
    let common = record["augmentation"]["common_error"].as_f64().unwrap();
    assert!((common / (0.12 * f64::from(factor)) - 1.0).abs() < 1e-4, "{common} {factor}");
    assert_eq!(record["error_bar"]["interval"]["probability"], 0.8);
    assert_eq!(record["error_bar"]["interval"]["by"], "learned/calibration.toml");

    // Of the same settings, for a map from a file.
    place.run(&LEARN.replace("--simulated model -o learned", "--method tiny.toml -q -o of-map"));
    let of_map = format!("{REFINE} --calibration of-map/calibration.toml -o map");
    place.prints(&of_map, 0, "does not name its network ; !other settings");

    if cfg!(feature = "onnx") {
        place.take(fixture("grey_nchw.onnx"), "net.onnx");
        place.write("net.toml", "width = 32\nheight = 24\noutput = 'metric'\n");
        let model = "--prior-model net.onnx --fov 60 --export sigma";
        place.run(&format!("refine image.png {model} --calibration learned/calibration.toml -o out"));
        let factor = place.record("out")["error_bar"]["factor"].as_f64().unwrap();
        assert!((factor - 1.0).abs() > 0.05, "{factor}");
        let parts =
            ["common", "spread", "disagreement"].map(|name| place.map(&format!("out/sigma/{name}.npy")));
        for (pixel, whole) in place.map("out/sigma.npy").indexed_iter() {
            let sum = parts.iter().map(|part| part[pixel].powi(2)).sum::<f32>().sqrt();
            assert!((sum / whole - 1.0).abs() < 1e-3, "{sum} {whole} {factor}");
        }
    }
}

#[test]
#[cfg(feature = "onnx")]
#[ignore = "needs the networks and photographs that MDE_SHARED names"]
fn the_doctor_tries_a_model() {
    let place = Place::new();
    let path = |name: &str| shared().join(name).display().to_string();
    let model = path("models/fastdepth/fastdepth_224.onnx");
    let small = path("models/upydnet_nyu48/model.onnx");
    place.write("small.toml", "width = 48\nheight = 48\noutput = 'metric'\n");
    place.take(&model, "model.onnx");
    let tried = "runtime tract: ;takes 30 by default;224x224, metric";
    let exchanged = "near and far are exchanged";
    for (arguments, code, words) in [
        (model.clone(), 0, tried),
        // Under another name its layers tell it.
        ("model.onnx".to_owned(), 0, tried),
        (format!("{model} --model-profile midas-v2.1-small"), 1, exchanged),
        (format!("{small} --model-profile small.toml --prior-kind disparity"), 0, "works here"),
        (format!("{small} --model-profile small.toml --prior-kind metric"), 1, "give --prior-kind disparity"),
    ] {
        let text = place.prints(&format!("doctor --prior-model {arguments}"), code, "");
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.split(';').all(|word| text.contains(word)), "{arguments}: {text}");
        assert_eq!(text.contains("verdict works here"), code == 0, "{arguments}: {text}");
        // A refinement warns of the same.
        let photograph = path("data/plain/nyu_00000/color.jpg");
        let refine =
            format!("refine {photograph} --predictions 1 --fov 60 --force -o out --prior-model {arguments}");
        assert_eq!(place.run(&refine).contains(exchanged), code == 1, "{arguments}");
    }
}
