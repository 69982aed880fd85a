//! `mde eval` and `mde ablate`.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, Place, WIDTH, copy, names, wait_until};
use mde_cli::mde_prior::format::{write_npy, write_png16};
use mde_cli::mde_prior::photo::write_image;
use mde_eval::scene::{Room, room};
use ndarray::Array2;
use predicates::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

const RESULTS: [&str; 7] = [
    "error-by-percentile.svg",
    "eval.json",
    "reliability.svg",
    "report.html",
    "scenes.csv",
    "sparsification.svg",
    "summary.json",
];

const ROOMS: &str = "eval --dataset rooms --size 64x48 --limit 2 -o e";

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// When the maps of a method were written.
fn written(place: &Place, scene: &str, method: &str) -> SystemTime {
    fs::metadata(place.path(&format!("e/scenes/{scene}/{method}/depth.npy"))).unwrap().modified().unwrap()
}

#[test]
fn methods_are_compared_and_nothing_is_run_twice() {
    let place = Place::new();
    let command = format!("{ROOMS} --methods tiny.toml,guided,unsharp1,zoom --preset default");
    // The simulated prior accepts no crops: that method fails with a message, the others run.
    let run = place.mde(&command).assert().code(3);
    run.stdout(
        predicate::str::contains("tables: e/table.md").and(predicate::str::contains("| guided |").not()),
    )
    .stderr(predicate::str::contains("zoom: failed").and(predicate::str::contains("name a model")));
    let table = fs::read_to_string(place.path("e/table.md")).unwrap();
    assert!(table.contains("| guided |") && table.contains("unsharp as sharp as tiny"), "{table}");
    let mut found = names(&place.path("e"));
    found.retain(|name| name != "scenes" && name != "table.md");
    assert_eq!(found, RESULTS);
    let summary = json(&place.path("e/summary.json"));
    assert_eq!(
        (summary["summary"]["scenes"].as_u64(), summary["failures"].as_array().unwrap().len()),
        (Some(2), 2)
    );
    let methods = summary["summary"]["methods"].as_array().unwrap();
    let of = |name: &str| methods.iter().find(|method| method["method"] == name).unwrap();
    assert!(of("guided")["metrics"]["mse"]["difference"]["value"].as_f64().unwrap().is_finite());
    assert!(of("prior")["metrics"]["mse"]["difference"].is_null());
    assert!(of("tiny")["metrics"]["coverage_90"]["mean"].as_f64().is_some());
    assert!(of("tiny, sigma by depth")["metrics"]["mse"].is_null());
    let rows = fs::read_to_string(place.path("e/scenes.csv")).unwrap();
    assert_eq!(rows.lines().filter(|line| line.contains(",guided,")).count(), 2);

    let before = written(&place, "study-0", "tiny");
    let again = place.mde(&command.replace(",zoom", ",wmf")).assert().success();
    again.stderr(predicate::str::contains("study-0 wmf:").and(predicate::str::contains("tiny:").not()));
    assert_eq!(written(&place, "study-0", "tiny"), before);

    let toml = fs::read_to_string(place.path("tiny.toml")).unwrap();
    place.write("tiny.toml", toml.replace("steps = 60", "steps = 61"));
    let changed = place.mde(&command.replace(",zoom", "")).assert().success();
    changed.stderr(predicate::str::contains(
        "study-0 tiny: computed again, since settings.method.config.nerf.train.steps: 60 -> 61",
    ));
    assert_ne!(written(&place, "study-0", "tiny"), before);

    // The simulated prior is of the seed.
    let prior = || fs::read(place.path("e/scenes/study-0/prior/depth.npy")).unwrap();
    let of_seed_0 = prior();
    place.mde(&format!("{ROOMS} --methods guided --seed 7")).assert().success();
    assert_ne!(prior(), of_seed_0);

    let other = place.mde(&command.replace("64x48", "32x24")).assert().code(1);
    other.stderr(
        predicate::str::contains("data.size: [64,48] -> [32,24]").and(predicate::str::contains("--force")),
    );
}

#[test]
fn a_killed_evaluation_goes_on_where_it_was() {
    let place = Place::new();
    let command =
        format!("{ROOMS} --methods guided,tiny.toml --limit 2 --jobs 1").replacen("--limit 2 ", "", 1);
    let toml = fs::read_to_string(place.path("tiny.toml")).unwrap();
    place.write("tiny.toml", toml.replace("steps = 60", "steps = 200000"));
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
        .current_dir(place.path(""))
        .args(command.split_whitespace())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let record = place.path("e/scenes/study-0/guided/method.json");
    wait_until(&mut child, || record.is_file());
    child.kill().unwrap();
    child.wait().unwrap();
    let before = written(&place, "study-0", "guided");
    place.write("tiny.toml", toml);
    // What was not finished leaves nothing behind.
    fs::create_dir_all(place.path("e/scenes/study-0/.mde-left")).unwrap();
    place.mde(&command).assert().success();
    assert!(fs::read_to_string(place.path("e/table.md")).unwrap().contains("| tiny |"));
    assert_eq!(written(&place, "study-0", "guided"), before);
    assert_eq!(names(&place.path("e/scenes/study-0")), ["guided", "picture.png", "prior", "tiny"]);
}

#[test]
fn a_broken_scene_is_told_and_the_rest_goes_on() {
    let place = Place::new();
    for (name, kind) in [("a", Room::Study), ("b", Room::Bedroom)] {
        let scene = room(kind, 0, WIDTH, HEIGHT).unwrap();
        let folder = place.path(&format!("data/{name}"));
        fs::create_dir_all(&folder).unwrap();
        write_image(folder.join("color.png"), scene.image.view()).unwrap();
        write_npy(folder.join("depth.npy"), scene.depth.view()).unwrap();
        fs::create_dir_all(place.path("priors")).unwrap();
        write_npy(place.path(&format!("priors/{name}.npy")), scene.depth.mapv(|z| 0.5 * z + 0.3).view())
            .unwrap();
        fs::write(folder.join("scene.json"), if name == "a" { "{" } else { "{}" }).unwrap();
    }
    let run = place.mde("eval data --prior-depth priors --methods jbf -o e").assert().code(3);
    run.stdout(
        predicate::str::contains("1 scene;").and(predicate::str::contains("failed: all methods on a")),
    )
    .stderr(
        predicate::str::contains("scene.json")
            .and(predicate::str::contains("b: no intrinsics; the camera is assumed")),
    );
    fs::write(place.path("data/a/scene.json"), "{}").unwrap();
    place.mde("eval data --prior-depth priors --methods jbf -o e").assert().success();
    fs::remove_file(place.path("priors/b.npy")).unwrap();
    let all = place.mde("eval data --prior-depth priors --methods jbf -o other --scenes b").assert().code(1);
    all.stderr(predicate::str::contains("no depth map b.npy"));
}

#[test]
fn maps_of_any_program_are_scored() {
    let place = Place::new();
    let truth = &place.scene.depth;
    for folder in ["pred/deep", "gt/deep", "sigma/deep"] {
        fs::create_dir_all(place.path(folder)).unwrap();
    }
    let prediction =
        Array2::from_shape_fn(truth.dim(), |(y, x)| truth[(y, x)] * (1.0 + 0.1 * ((x / 8) % 2) as f32));
    write_npy(place.path("pred/a.npy"), prediction.view()).unwrap();
    write_png16(place.path("pred/deep/b.png"), prediction.view(), 2000.0).unwrap();
    write_png16(place.path("gt/a.png"), truth.view(), 1000.0).unwrap();
    write_npy(place.path("gt/deep/b.npy"), truth.view()).unwrap();
    for name in ["a", "deep/b"] {
        write_npy(place.path(&format!("sigma/{name}.npy")), truth.mapv(|z| 0.05 * z).view()).unwrap();
    }
    let plain = place.mde("eval --pred pred --gt gt -o plain").assert().success();
    plain.stdout(predicate::str::contains("2 scenes; report: plain/report.html"));
    let plain = fs::read_to_string(place.path("plain/table.md")).unwrap();
    assert!(plain.contains("| maps |") && !plain.contains("Spearman"), "{plain}");
    place.mde("eval --pred pred --gt gt --sigma sigma -o whole").assert().success();
    let rows = fs::read_to_string(place.path("whole/scenes.csv")).unwrap();
    assert_eq!(rows.lines().count(), 3);
    let column = rows.lines().next().unwrap().split(',').position(|name| name == "mse").unwrap();
    let mse = |row: &str| row.split(',').nth(column).unwrap().parse::<f64>().unwrap();
    let values: Vec<f64> = rows.lines().skip(1).map(mse).collect();
    // The same map in two formats: PNG keeps half a millimetre.
    assert!((values[0] / values[1] - 1.0).abs() < 0.02 && values[0] > 0.0, "{values:?}");
    assert!(place.path("whole/reliability.svg").is_file() && !place.path("plain/reliability.svg").exists());
    // Without a sigma no figure of one stays.
    place.mde("eval --pred pred --gt gt -o whole --force").assert().success();
    assert!(!place.path("whole/reliability.svg").exists());
    assert!(!fs::read_to_string(place.path("whole/report.html")).unwrap().contains("sparsification"));
    write_npy(place.path("pred/c.npy"), prediction.view()).unwrap();
    let extra = place.mde("eval --pred pred --gt gt -o extra").assert().success();
    extra.stderr(predicate::str::contains("c: no truth of that name"));
    write_npy(place.path("gt/c.npy"), Array2::<f32>::ones((3, 4)).view()).unwrap();
    let wrong = place.mde("eval --pred pred --gt gt -o wrong").assert().code(3);
    wrong.stderr(predicate::str::contains("c.npy").and(predicate::str::contains("[3, 4]")));
}

/// Beside our own methods; other maps in the folder are scored again.
#[test]
fn maps_of_another_program_are_a_method() {
    let place = Place::new();
    fs::create_dir(place.path("theirs")).unwrap();
    let exact = room(Room::Study, 0, 64, 48).unwrap().depth;
    let put = |factor: f32| {
        let bent =
            Array2::from_shape_fn(exact.dim(), |(y, x)| exact[(y, x)] * (1.0 + factor * x as f32 / 64.0));
        write_npy(place.path("theirs/study-0.npy"), bent.view()).unwrap();
    };
    let error = || {
        let summary = json(&place.path("e/summary.json"));
        let methods = summary["summary"]["methods"].as_array().unwrap().clone();
        let own = methods.iter().find(|method| method["method"] == "theirs").unwrap();
        own["metrics"]["abs_rel"]["mean"].as_f64().unwrap()
    };
    let command = "eval --dataset rooms --size 64x48 --limit 1 -o e --methods theirs=theirs";
    put(0.0);
    place.mde(command).assert().success();
    assert!(error() < 1e-6, "{}", error());
    put(0.3);
    place.mde(command).assert().success();
    assert!((0.02..0.2).contains(&error()), "{}", error());
    fs::remove_file(place.path("theirs/study-0.npy")).unwrap();
    let run = place.mde(command).assert().code(3);
    run.stderr(predicate::str::contains("no depth map study-0.npy"));
    let nowhere = place.mde(&command.replace("=theirs", "=nowhere")).assert().failure();
    nowhere.stderr(predicate::str::contains("nowhere"));
}

#[test]
fn rows_of_an_ablation_share_their_field() {
    let place = Place::new();
    // The field's own depth: nothing reverts to the prior.
    let toml = fs::read_to_string(place.path("tiny.toml")).unwrap();
    place.write("tiny.toml", toml + "fusion = 'nerf-only'\ncalibration = 'none'\n");
    let command = "ablate --dataset rooms --size 64x48 --limit 1 --seeds 2 --config tiny.toml -o e \
                   --rows min-depth,guided-for-nerf,in-bin";
    place.mde(command).assert().success();
    let table = fs::read_to_string(place.path("e/table.md")).unwrap();
    assert!(table.contains("The paper's Table II") && table.contains("| min-depth |"), "{table}");
    let rows = fs::read_to_string(place.path("e/scenes.csv")).unwrap();
    assert_eq!(rows.lines().filter(|line| line.contains(",full,")).count(), 2);
    // What is shared is what the row would have made alone.
    let depth = |name: &str| fs::read(place.path(&format!("e/scenes/study-0/{name}/depth.npy"))).unwrap();
    let shared = ["min-depth.seed1", "in-bin.seed1"].map(depth);
    let alone = |row: &str| {
        place
            .mde(
                &command.replace("min-depth,guided-for-nerf,in-bin", row).replace("-o e", "-o alone --force"),
            )
            .assert()
            .success();
        fs::read(place.path(&format!("alone/scenes/study-0/{row}.seed1/depth.npy"))).unwrap()
    };
    assert_eq!(shared, ["min-depth", "in-bin"].map(alone));
    assert_ne!(depth("full.seed0"), depth("full.seed1"));
    assert_ne!(depth("full.seed0"), depth("guided-for-nerf.seed0"));
}

#[test]
fn what_cannot_be_evaluated_is_told_in_one_line() {
    let place = Place::new();
    fs::create_dir(place.path("full")).unwrap();
    fs::create_dir(place.path("maps")).unwrap();
    place.write("full/thesis.txt", "years");
    write_npy(place.path("maps/a.npy"), place.scene.depth.view()).unwrap();
    for (arguments, code, words) in [
        ("eval -o e", 1, &["--dataset rooms"][..]),
        ("eval --dataset rooms --methods blur -o e", 1, &["`blur`", "guided"]),
        ("eval --dataset rooms --methods jbf,jbf -o e", 1, &["jbf", "twice"]),
        ("eval --dataset rooms --methods none.toml -o e", 1, &["none.toml"]),
        ("eval --dataset kitti x -o e", 2, &["sunrgbd"]),
        ("eval none --dataset sunrgbd --prior-depth x -o e", 1, &["none"]),
        ("eval . --dataset plain --prior-depth x -o e", 1, &["scene.json"]),
        ("eval --dataset rooms --scenes attic -o e", 1, &["attic", "study-0"]),
        ("eval --dataset rooms --limit 1 --size 64x48 --methods guided -o full", 1, &["full", "eval.json"]),
        ("eval --pred none --gt none -o e", 1, &["none"]),
        ("eval --pred . -o e", 2, &["--gt"]),
        ("eval --pred . --gt . --methods jbf -o e", 2, &["--methods"]),
        ("eval --pred . --gt . --shared-alignment -o e", 2, &["--shared-alignment"]),
        ("eval --pred . --gt . --preset fast -o e", 2, &["--preset"]),
        ("eval --pred maps --gt maps --scenes a,attic -o e", 1, &["--scenes attic"]),
        ("ablate --dataset rooms --rows best -o e", 1, &["best", "min-depth"]),
        (
            "eval --dataset rooms --limit 1 --size 64x48 --max-depth 0.0001 --methods guided -o e",
            1,
            &["max-depth"],
        ),
    ] {
        let run = place.mde(arguments).assert().code(code);
        let text = String::from_utf8(run.get_output().stderr.clone()).unwrap();
        assert!(words.iter().all(|word| text.contains(word)), "{arguments}: {text}");
        assert!(
            code == 2 || text.lines().filter(|line| line.starts_with("error:")).count() == 1,
            "{arguments}: {text}"
        );
    }
    assert_eq!(names(&place.path("full")), ["thesis.txt"]);
}

/// Parts in one folder, then the plain command: the results of one evaluation, but for the seconds and the command line.
#[test]
fn shards_and_a_plain_run_are_as_one_evaluation() {
    let place = Place::new();
    // One method fails on every scene, as the simulated prior accepts no crops.
    let eval = |rest: &str| {
        let eval = "eval --dataset rooms --size 64x48 --limit 5 --methods tiny.toml,guided,zoom -q";
        place.mde(&format!("{eval} {rest}")).assert()
    };
    eval("-o whole").code(3);
    for shard in ["3/3", "1/3"] {
        // A part may have no scene.
        eval(&format!("--shard {shard} -o parts")).code(predicate::in_iter([0, 3]));
        assert!(!place.path("parts/table.md").exists());
    }
    let refused = eval("--shard 1/3 -o parts --force").code(1);
    refused.stderr(predicate::str::contains("other shards"));
    eval("-o parts").code(3);
    let scenes = names(&place.path("whole/scenes"));
    assert_eq!(names(&place.path("parts/scenes")), scenes);
    for scene in &scenes {
        let map = |out: &str| fs::read(place.path(&format!("{out}/scenes/{scene}/tiny/depth.npy"))).unwrap();
        assert!(map("parts") == map("whole"), "{scene}");
    }
    // From the same maps with their seconds, all files are the same.
    fs::remove_dir_all(place.path("parts")).unwrap();
    copy(&place.path("whole/scenes"), &place.path("parts/scenes"));
    fs::copy(place.path("whole/eval.json"), place.path("parts/eval.json")).unwrap();
    for shard in ["1/2", "2/2"] {
        eval(&format!("--shard {shard} -o parts")).code(predicate::in_iter([0, 3]));
    }
    eval("-o parts").code(3);
    let without_command = |out: &str| {
        let mut summary = json(&place.path(out).join("summary.json"));
        summary.as_object_mut().unwrap().remove("command_line");
        summary
    };
    assert_eq!(without_command("parts"), without_command("whole"));
    let mut files = names(&place.path("whole"));
    assert_eq!(files, names(&place.path("parts")));
    files.retain(|name| !["scenes", "summary.json", "report.html"].contains(&&**name));
    for file in files {
        let bytes = |out: &str| fs::read(place.path(out).join(&file)).unwrap();
        assert!(bytes("parts") == bytes("whole"), "{file}");
    }
}
