//! `mde eval`, `mde ablate`, `mde score`: what is scored is what `mde refine` writes; kept results belong to the content of the inputs.

use crate::common::{HEIGHT, Place, WIDTH, copy, fixture, names, report_data, tiny, wait_until};
use mde_cli::mde_prior::format::write_png16;
use ndarray::Array2;
use std::fs;

const RESULTS: &str = "error-by-percentile.svg eval.json reliability.svg \
                       report.html scenes scenes.csv sparsification.svg summary.json table.md";

const EVAL: &str = "eval --dataset rooms --size 64x48 --limit 1";

fn anew(place: &Place, arguments: &str) -> bool {
    place.run(arguments).contains("computed again")
}

#[test]
fn methods_are_compared_and_nothing_is_run_twice() {
    let place = Place::new();
    let command = "eval --dataset rooms --size 64x48 --limit 2 -o e --methods tiny.toml,guided,unsharp1,zoom";
    // The simulated prior accepts no crops: that method fails with a message, the others run.
    place.prints(command, 3, "tables: e/table.md ; zoom: failed ; name a model ; !| guided |");
    let table = place.text("e/table.md");
    assert!(table.contains("| guided |") && table.contains("unsharp as sharp as tiny"), "{table}");
    assert_eq!(names(&place.path("e")).join(" "), RESULTS);
    let summary = place.json("e/summary.json");
    let failures = summary["failures"].as_array().unwrap().len();
    assert_eq!((summary["summary"]["scenes"].as_u64(), failures), (Some(2), 2));
    let methods = summary["summary"]["methods"].as_array().unwrap();
    let of = |name: &str| &methods.iter().find(|method| method["method"] == name).unwrap()["metrics"];
    assert!(of("guided")["mse"]["difference"]["value"].as_f64().unwrap().is_finite());
    assert!(of("prior")["mse"]["difference"].is_null() && of("tiny, sigma by depth")["mse"].is_null());
    assert!(of("tiny")["coverage_90"]["mean"].as_f64().is_some());
    let rows = place.text("e/scenes.csv");
    assert_eq!(rows.lines().filter(|line| line.contains(",guided,")).count(), 2);

    // The page has thumbnails, and can be made again.
    let html = place.text("e/report.html");
    let data = report_data(&html);
    assert_eq!((&data["kind"], data["figures"].as_array().unwrap().len()), (&"evaluation".into(), 3));
    let told = shlex::split(data["summary"]["command_line"].as_str().unwrap()).unwrap();
    assert_eq!(told.join(" "), format!("mde {command}"));
    let scenes = data["scenes"].as_array().unwrap();
    assert_eq!(scenes.len(), 2);
    for scene in scenes {
        assert!(scene["thumbnails"]["image"].as_str().unwrap().starts_with("data:image/png;base64,"));
        let maps = scene["thumbnails"]["maps"].as_array().unwrap();
        let sigma =
            |method: &str| maps.iter().find(|map| map["method"] == method).unwrap()["sigma"].is_string();
        assert!(!sigma("prior") && !sigma("guided") && sigma("tiny"));
        assert!(scene["scores"]["tiny"]["abs_rel"].as_f64().unwrap() > 0.0);
    }
    fs::remove_file(place.path("e/report.html")).unwrap();
    place.run("report e");
    assert!(place.text("e/report.html") == html);

    let written = || fs::metadata(place.path("e/scenes/study-0/tiny/depth.npy")).unwrap().modified().unwrap();
    let before = written();
    place.prints(&command.replace(",zoom", ",noise"), 0, "study-0 noise: ; !0 tiny:");
    assert_eq!(written(), before);
    place.write("tiny.toml", tiny(61, 2));
    let why = "study-0 tiny: computed again, since settings.method.config.nerf.train.steps: 60 -> 61";
    place.prints(&command.replace(",zoom", ""), 0, why);
    assert_ne!(written(), before);

    // The simulated prior is of the seed.
    let prior = || place.bytes("e/scenes/study-0/prior/depth.npy");
    let of_seed_0 = prior();
    place.run("eval --dataset rooms --size 64x48 --limit 2 -o e --methods guided --seed 7");
    assert_ne!(prior(), of_seed_0);
    place.refused(&command.replace("64x48", "32x24"), "data.size: [64,48] -> [32,24] ; --force");
}

#[test]
fn maps_of_any_program_are_scored() {
    let place = Place::new();
    let truth = &place.scene.depth;
    let prediction =
        Array2::from_shape_fn(truth.dim(), |(y, x)| truth[(y, x)] * (1.0 + 0.1 * ((x / 8) % 2) as f32));
    place.save("pred/a.npy", &prediction);
    place.save("gt/deep/b.npy", truth);
    for name in ["a", "deep/b"] {
        place.save(&format!("sigma/{name}.npy"), &truth.mapv(|z| 0.05 * z));
    }
    fs::create_dir(place.path("pred/deep")).unwrap();
    write_png16(place.path("pred/deep/b.png"), prediction.view(), 2000.0).unwrap();
    write_png16(place.path("gt/a.png"), truth.view(), 1000.0).unwrap();
    let score = "score pred --gt gt";
    place.prints(&format!("{score} -o plain"), 0, "2 scenes; report: plain/report.html");
    let table = place.text("plain/table.md");
    assert!(table.contains("| maps |") && !table.contains("Spearman"), "{table}");
    place.run(&format!("{score} --sigma sigma -o whole"));
    let text = place.text("whole/scenes.csv");
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let column = rows[0].iter().position(|name| *name == "mse").unwrap();
    let values: Vec<f64> = rows[1..].iter().map(|row| row[column].parse().unwrap()).collect();
    // The same map in two formats: PNG keeps half a millimetre.
    assert!(values.len() == 2 && (values[0] / values[1] - 1.0).abs() < 0.02 && values[0] > 0.0, "{values:?}");
    assert!(place.has("whole/reliability.svg") && !place.has("plain/reliability.svg"));
    // Without a sigma no figure of one stays.
    place.run(&format!("{score} -o whole --force"));
    assert!(!place.has("whole/reliability.svg") && !place.has("whole/reliability.png"));
    assert!(!place.text("whole/report.html").contains("sparsification"));
    place.save("pred/c.npy", &prediction);
    place.prints(&format!("{score} -o extra"), 0, "c: no truth of that name");
}

#[test]
fn rows_of_an_ablation_share_their_field() {
    let place = Place::new();
    // The field's own depth: nothing reverts to the prior.
    place.write("tiny.toml", tiny(20, 2) + "fusion.fusion = 'nerf-only'\nfusion.calibration = 'none'\n");
    let rows = "min-depth,guided-for-nerf,in-bin";
    let command = format!(
        "ablate --dataset rooms --size 64x48 --limit 1 --seeds 2 --config tiny.toml -o e --rows {rows}"
    );
    place.run(&command);
    let table = place.text("e/table.md");
    assert!(table.contains("The paper's Table II") && table.contains("| min-depth |"), "{table}");
    assert_eq!(place.text("e/scenes.csv").lines().filter(|line| line.contains(",full,")).count(), 2);
    // What is shared is what the row would have made alone.
    let depth = |name: &str| place.bytes(&format!("e/scenes/study-0/{name}/depth.npy"));
    for row in ["min-depth", "in-bin"] {
        place.run(&command.replace(rows, row).replace("-o e", "-o alone --force"));
        let alone = place.bytes(&format!("alone/scenes/study-0/{row}.seed1/depth.npy"));
        assert!(depth(&format!("{row}.seed1")) == alone, "{row}");
    }
    assert_ne!(depth("full.seed0"), depth("full.seed1"));
    assert_ne!(depth("full.seed0"), depth("guided-for-nerf.seed0"));
}

/// Parts in one folder, then the plain command: the results of one evaluation, but for the seconds and the command line.
#[test]
fn shards_and_a_plain_run_are_as_one_evaluation() {
    let place = Place::new();
    place.write("tiny.toml", tiny(5, 2));
    // One method fails on every scene, as the simulated prior accepts no crops.
    let command = "eval --dataset rooms --size 64x48 --limit 5 --methods tiny.toml,guided,zoom -q";
    let eval = |rest: &str| drop(place.prints(&format!("{command} {rest}"), 3, ""));
    // A part may have no scene.
    let shard = |number: &str| {
        let part = place.mde(&format!("{command} --shard {number} -o parts")).assert();
        assert!(matches!(part.get_output().status.code(), Some(0 | 3)), "{part}");
    };
    eval("-o whole");
    shard("3/3");
    shard("1/3");
    assert!(!place.has("parts/table.md"));
    place.refused(&format!("{command} --shard 1/3 -o parts --force"), "other shards");
    eval("-o parts");
    assert!(place.maps("parts") == place.maps("whole"));
    // From the same maps with their seconds, all files are the same.
    fs::remove_dir_all(place.path("parts")).unwrap();
    copy(&place.path("whole/scenes"), &place.path("parts/scenes"));
    place.take("whole/eval.json", "parts/eval.json");
    shard("1/2");
    shard("2/2");
    eval("-o parts");
    let without_command = |out: &str| {
        let mut summary = place.json(&format!("{out}/summary.json"));
        summary.as_object_mut().unwrap().remove("command_line");
        summary
    };
    assert_eq!(without_command("parts"), without_command("whole"));
    let files = names(&place.path("whole"));
    assert_eq!(files, names(&place.path("parts")));
    for file in
        files.iter().filter(|name| !["scenes", "summary.json", "report.html"].contains(&name.as_str()))
    {
        assert!(place.bytes(&format!("parts/{file}")) == place.bytes(&format!("whole/{file}")), "{file}");
    }
}

/// So are the maps of another program, which are a method beside our own.
#[test]
fn a_prior_is_known_by_its_content_and_not_by_its_folder() {
    let place = Place::new();
    let wrong = Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| 1.0 + (x * y) as f32 * 1e-3);
    place.save("pr/study-0.npy", &wrong);
    place.save("theirs/study-0.npy", &wrong);
    let eval = |rest: &str| format!("{EVAL} --methods prior,theirs=theirs -o e --prior-depth {rest}");
    let score = |method: &str| {
        let summary = place.json("e/summary.json");
        let mut methods = summary["summary"]["methods"].as_array().unwrap().iter();
        let metrics = &methods.find(|one| one["method"] == method).unwrap()["metrics"];
        metrics["abs_rel"]["mean"].as_f64().unwrap()
    };
    place.run(&eval("pr"));
    let wrong = score("prior");
    assert!((score("theirs") - wrong).abs() < 1e-9);
    // The same files by another path, and elsewhere. Kept scores may differ in their last digit.
    fs::create_dir(place.path("x")).unwrap();
    assert!(!anew(&place, &eval("x/../pr")));
    fs::rename(place.path("pr"), place.path("moved")).unwrap();
    assert!(!anew(&place, &eval("moved")) && wrong > 0.1 && (score("prior") - wrong).abs() < 1e-9);
    // Other files of the same names.
    place.save("moved/study-0.npy", &place.scene.depth);
    assert!(anew(&place, &eval("moved")) && score("prior") < 1e-9 && score("theirs") > 0.1);
    place.save("theirs/study-0.npy", &place.scene.depth);
    assert!(anew(&place, &eval("moved")) && score("theirs") < 1e-9);
    // The same files, read otherwise.
    assert!(anew(&place, &eval("moved --png-scale 2")));
}

#[cfg(feature = "onnx")]
#[test]
fn weights_beside_the_model_count_as_the_model() {
    let place = Place::new();
    place.take(fixture("external.onnx"), "external.onnx");
    place.write("external.toml", "width = 32\nheight = 32\noutput = 'metric'\n");
    let short = tiny(10, 1);
    place.write("short.toml", format!("augmentation.predictions = 1\n{short}"));
    let weights = [0.9_f32, 0.05, 0.05].map(f32::to_le_bytes).concat();
    let rooms = "--dataset rooms --size 64x48 --prior-model external.onnx";
    for command in [
        format!("eval {rooms} --limit 1 --methods prior -o e"),
        format!("ablate {rooms} --limit 1 --rows min-depth --seeds 1 --config short.toml -o a"),
        format!("calibrate {rooms} --limit 3 --method short.toml -o c"),
    ] {
        place.take(fixture("external.bin"), "external.bin");
        place.run(&command);
        assert!(!anew(&place, &command), "{command}");
        place.write("external.bin", &weights);
        assert!(anew(&place, &command), "{command}");
    }
}

#[test]
fn a_damaged_map_is_computed_again() {
    let place = Place::new();
    let eval = format!("{EVAL} --methods guided -o e");
    place.run(&eval);
    let map = "e/scenes/study-0/guided/depth.npy";
    let whole = place.bytes(map);
    let mut altered = whole.clone();
    *altered.last_mut().unwrap() ^= 1;
    for broken in [Some(&altered[..]), Some(&whole[..whole.len() / 2]), Some(&[]), None] {
        match broken {
            Some(bytes) => place.write(map, bytes),
            None => fs::remove_file(place.path(map)).unwrap(),
        }
        place.prints(&eval, 0, "guided: computed again");
        assert!(place.bytes(map) == whole);
    }
    assert!(!anew(&place, &eval));
}

#[test]
fn one_evaluation_at_a_time_writes_a_folder() {
    let place = Place::new();
    place.write("long.toml", tiny(100000, 2));
    let (mut first, _lines) = place.start(&format!("{EVAL} --methods long.toml -q -o e"));
    wait_until(&mut first, || place.has("e/eval.json"));
    let second = format!("{EVAL} --methods guided -q -o e");
    place.refused(&second, &format!("another process ({}) ; -o", first.id()));
    // The lock of a killed process holds nobody.
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(place.has("e/.mde-lock"));
    place.run(&second);
    assert!(!names(&place.path("e")).iter().any(|name| name.starts_with('.')));
}

/// What is scored is what a refinement writes, byte for byte.
#[cfg(feature = "onnx")]
mod same_bytes {
    use super::*;
    use crate::common::{on_disk, rendered};
    use mde_eval::scene::Room;
    use serde_json::json;

    /// Its depth is the brightness.
    const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth -q";

    fn assert_same(place: &Place, scored: &str, refined: &str) {
        let (scored, refined) = (place.maps(scored), place.maps(refined));
        assert!(scored.len() == 2 && scored.iter().all(|(map, bytes)| refined[map] == *bytes));
    }

    #[test]
    fn one_photograph() {
        let place = Place::new();
        place.take(fixture("grey_nchw.onnx"), "grey.onnx");
        place.take("image.png", "data/room/color.png");
        place.take("depth.npy", "data/room/depth.npy");
        let camera = place.scene.camera;
        let about = json!({ "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy }).to_string();
        place.write("data/room/scene.json", &about);
        place.write("intrinsics.json", &about);
        place.run(&format!("eval data --methods default,fast {MODEL} -o scored"));
        for preset in ["default", "fast"] {
            let refine = format!("refine data/room/color.png --intrinsics intrinsics.json --preset {preset}");
            place.run(&format!("{refine} {MODEL} -o {preset}"));
            assert_same(&place, &format!("scored/scenes/room/{preset}"), preset);
        }
    }

    #[test]
    fn several_photographs_with_poses() {
        let room = rendered(Room::Study, 3, [64, 48]);
        let place = on_disk(&room);
        copy(&place.path("images"), &place.path("data/room/images"));
        write_png16(place.path("data/room/truth.png"), room.truth.view(), 1000.0).unwrap();
        let mut capture = place.json("transforms.json");
        capture["frames"][0]["depth_file_path"] = json!("truth.png");
        place.write("data/room/transforms.json", capture.to_string());
        place.write("data/room/scene.json", "{}");
        place.run(&format!("eval data --dataset posed --methods multi-view:quick.toml {MODEL} -o scored"));
        let refine = "refine data/room/images/0.png --views data/room/transforms.json --config quick.toml --unit capture";
        place.run(&format!("{refine} {MODEL} -o several"));
        assert_same(&place, "scored/scenes/room/quick", "several");
    }
}
