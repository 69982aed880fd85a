//! `mde refine` on many photographs: each as a run of its own would have it, resumed after a kill, in shards.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{Course, Place, names};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_depth_png};
use mde_cli::mde_prior::photo::write_image;
use mde_eval::scene::{Room, room};
use ndarray::{ArrayView3, s};
use predicates::prelude::*;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::Path;

const MAPS: [&str; 6] = ["depth.npy", "sigma.npy", "prior.npy", "depth.png", "confidence.png", "preview.png"];
const MOMENTS: u32 = 12;

/// `shots/` with photographs of rooms, and `grey.onnx`: depth by the brightness.
fn place(count: usize) -> Place {
    let place = Place::new();
    fs::create_dir(place.path("shots")).unwrap();
    for seed in 0..count {
        let scene = room(Room::ALL[seed % Room::ALL.len()], seed as u64, 64, 48).unwrap();
        write_image(place.path(&format!("shots/{seed:02}.png")), scene.image.view()).unwrap();
    }
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    fs::copy(fixtures.join("grey_nchw.onnx"), place.path("grey.onnx")).unwrap();
    place
}

const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth --fov 60";

fn maps(folder: &Path) -> [Vec<u8>; 6] {
    MAPS.map(|name| fs::read(folder.join(name)).unwrap())
}

/// The maps of each finished photograph.
fn all(folder: &Path) -> BTreeMap<String, [Vec<u8>; 6]> {
    let folders =
        names(folder).into_iter().filter(|name| !name.starts_with('.') && folder.join(name).is_dir());
    folders.map(|name| (name.clone(), maps(&folder.join(&name)))).collect()
}

fn index(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("index.json")).unwrap()).unwrap()
}

fn stderr(place: &Place, arguments: &str) -> String {
    String::from_utf8(place.mde(arguments).assert().get_output().stderr.clone()).unwrap()
}

#[test]
fn each_photograph_is_as_a_run_of_its_own_has_it() {
    let place = place(4);
    place.mde(&format!("refine shots {MODEL} -o out")).assert().success();
    let found = all(&place.path("out"));
    assert_eq!(found.keys().collect::<Vec<_>>(), ["00", "01", "02", "03"]);
    for (name, maps_of) in &found {
        place.mde(&format!("refine shots/{name}.png {MODEL} -q -o one{name}")).assert().success();
        assert!(maps(&place.path(&format!("one{name}"))) == *maps_of, "{name}");
        let config = |folder: String| fs::read(place.path(&folder).join("config.toml")).unwrap();
        assert_eq!(config(format!("out/{name}")), config(format!("one{name}")));
    }
    let table = fs::read_to_string(place.path("out/index.csv")).unwrap();
    assert_eq!((table.lines().count(), table.matches(",done,").count()), (5, 4));
    let page = fs::read_to_string(place.path("out/index.html")).unwrap();
    for name in found.keys() {
        assert!(
            page.contains(&format!("href=\"{name}/report.html\""))
                && page.contains(&format!("src=\"{name}/thumbnail.png\""))
        );
        assert!(place.path(&format!("out/{name}/thumbnail.png")).is_file());
    }
    let row = &index(&place.path("out"))["photographs"][0];
    assert_eq!((row["width"].as_u64(), row["camera"].as_str()), (Some(64), Some("field-of-view")));
    assert!(row["sigma"].as_f64().unwrap() > 0.0 && row["median_depth"].as_f64().unwrap() > 0.0);

    place
        .mde(&format!("refine shots {MODEL} --interval 0.8 -o intervals"))
        .assert()
        .success()
        .stdout(predicate::str::contains("lower.npy and upper.npy in each folder: 80 % interval\nwrote "));
    assert!(place.path("intervals/03/upper.npy").is_file());

    // Emptied, cut or removed maps are made again.
    fs::write(place.path("out/00/depth.npy"), "").unwrap();
    let cut = fs::read(place.path("out/01/sigma.npy")).unwrap();
    fs::write(place.path("out/01/sigma.npy"), &cut[..cut.len() / 2]).unwrap();
    fs::remove_file(place.path("out/02/depth.npy")).unwrap();
    let again = place.mde(&format!("refine shots {MODEL} -o out")).assert().success();
    again.stdout(predicate::str::contains("3 refined, 1 finished before"));
    assert!(all(&place.path("out")) == found);

    // Again: nothing to do. One changed, one more, one gone, other settings: as much as that.
    let finished = |text: &str| text.matches("finished before").count();
    assert_eq!(finished(&stderr(&place, &format!("refine shots {MODEL} -o out"))), 4);
    fs::copy(place.path("shots/03.png"), place.path("shots/01.png")).unwrap();
    fs::copy(place.path("shots/02.png"), place.path("shots/09.png")).unwrap();
    fs::remove_file(place.path("shots/02.png")).unwrap();
    assert_eq!(finished(&stderr(&place, &format!("refine shots {MODEL} -o out"))), 2);
    let again = all(&place.path("out"));
    assert!(again["01"] == found["03"] && again["09"] == found["02"] && again["00"] == found["00"]);
    assert_eq!(index(&place.path("out"))["photographs"].as_array().unwrap().len(), 4);
    assert_eq!(finished(&stderr(&place, &format!("refine shots {MODEL} --seed 5 -o out"))), 0);
}

/// A graph whose values are larger below, as the disparity of rooms is: taken for a depth, near and far are exchanged.
#[test]
fn exchanged_near_and_far_are_told_where_only_the_user_or_a_name_says_what_a_network_gives() {
    const TOLD: &str = "near and far are exchanged";
    let place = place(2);
    let net = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures/rows.onnx");
    for name in ["net.onnx", "zoedepth.onnx", "hub/model.onnx", "dpt_large.onnx"] {
        fs::create_dir_all(place.path(name).parent().unwrap()).unwrap();
        fs::copy(&net, place.path(name)).unwrap();
    }
    fs::write(place.path("hub/config.json"), r#"{"model_type": "zoedepth"}"#).unwrap();
    let one = |model: &str| {
        let run = place.mde(&format!(
            "refine shots/00.png --predictions 1 --fov 60 --force -o one --prior-model {model}"
        ));
        let output = { run }.assert().success();
        let text = String::from_utf8(output.get_output().stderr.clone()).unwrap();
        let record = fs::read_to_string(place.path("one/run.json")).unwrap();
        assert_eq!(record.contains(TOLD), text.contains(TOLD), "{text}");
        (text, fs::read(place.path("one/depth.npy")).unwrap())
    };
    let size = "--input-size 32x24";
    for right in [&format!("net.onnx {size} --prior-kind disparity"), "dpt_large.onnx"] {
        let (text, _) = one(right);
        assert!(!text.contains(TOLD), "{right}: {text}");
    }
    for wrong in [&format!("net.onnx {size} --prior-kind depth"), "zoedepth.onnx"] {
        let (text, depth) = one(wrong);
        let lines: Vec<_> = text.lines().filter(|line| line.contains(TOLD)).collect();
        assert!(lines.len() == 1 && lines[0].contains("give --prior-kind disparity"), "{wrong}: {text}");
        // What the files of a hub tell is not tried, and gives the same depth.
        if wrong == "zoedepth.onnx" {
            let (text, told) = one("hub/model.onnx");
            assert!(!text.contains(TOLD) && told == depth, "{text}");
        }
    }
    let (text, _) = one("hub/model.onnx --prior-kind depth");
    assert!(text.contains(TOLD), "{text}");
    let many = format!(
        "refine shots --predictions 1 --fov 60 -o out --prior-model net.onnx {size} --prior-kind metric"
    );
    let text = stderr(&place, &many);
    let lines: Vec<_> = text.lines().filter(|line| line.contains(TOLD)).collect();
    assert!(lines.len() == 1 && lines[0].contains("2 of 2 photographs: net.onnx: near"), "{text}");
    // `mde doctor` fails for the same reason.
    let doctor = |kind: &str| place.mde(&format!("doctor --prior-model net.onnx {size} --prior-kind {kind}"));
    doctor("disparity").assert().success();
    let said = doctor("depth").assert().code(1);
    said.stderr(predicate::str::contains(TOLD).and(predicate::str::contains("give --prior-kind disparity")));
}

#[test]
fn what_fails_is_a_row_and_the_others_are_refined() {
    let place = place(2);
    fs::create_dir(place.path("other")).unwrap();
    fs::copy(place.path("shots/00.png"), place.path("other/00.PNG")).unwrap();
    fs::write(place.path("shots/broken.jpg"), "no picture").unwrap();
    fs::write(place.path("shots/notes.txt"), "not a photograph").unwrap();
    fs::copy(place.path("shots/00.png"), place.path("odd , name?.png")).unwrap();
    fs::write(place.path("list.txt"), "# more\nodd , name?.png\nabsent.png\n").unwrap();
    // Names twice, names that collide, a list.
    let run = format!("refine shots shots/01.png other list.txt {MODEL} -o out");
    place
        .mde(&run)
        .assert()
        .code(3)
        .stderr(predicate::str::contains("2 of the runs failed"))
        .stdout(predicate::str::contains("6 photographs: 4 refined, 0 finished before, 2 failed"));
    let rows = index(&place.path("out"))["photographs"].as_array().unwrap().clone();
    let failed: Vec<(&str, &str)> =
        rows.iter().filter_map(|row| Some((row["photograph"].as_str()?, row["error"].as_str()?))).collect();
    assert_eq!(failed.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["shots/broken.jpg", "absent.png"]);
    assert!(
        failed[0].1.contains("no readable image") && failed[1].1.contains("no such photograph"),
        "{failed:?}"
    );
    assert_eq!(all(&place.path("out")).keys().collect::<Vec<_>>(), ["00", "00_2", "01", "odd___name_"]);
    // Mended, it is refined; the others are kept.
    fs::copy(place.path("shots/01.png"), place.path("shots/broken.jpg")).unwrap();
    fs::copy(place.path("shots/01.png"), place.path("absent.png")).unwrap();
    place.mde(&run).assert().success().stdout(predicate::str::contains("2 refined, 4 finished before"));

    let names_by_pipe = place
        .mde(&format!("refine - {MODEL} -o piped"))
        .write_stdin("shots/00.png\n\nshots/01.png\n")
        .assert();
    names_by_pipe.success().stdout(predicate::str::contains("2 photographs: 2 refined"));
}

#[test]
fn what_is_for_one_photograph_is_refused_in_a_line() {
    let place = place(1);
    fs::create_dir(place.path("empty")).unwrap();
    fs::create_dir(place.path("foreign")).unwrap();
    fs::write(place.path("foreign/thesis.txt"), "years").unwrap();
    for (arguments, word) in [
        (format!("refine empty {MODEL} -o out"), "holds no photograph"),
        (format!("refine shots {MODEL}"), "-o: give a folder"),
        (format!("refine shots {MODEL} -o foreign"), "holds no index.json"),
        (format!("refine shots {MODEL} --views shots -o out"), "--views"),
        ("refine shots --prior-depth depth.npy -o out".to_owned(), "--prior-depth"),
        (format!("refine shots/00.png {MODEL} --same-scale -o out"), "--same-scale"),
    ] {
        let refused = place.mde(&arguments).assert().code(1);
        let text = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
        assert!(text.contains(word) && text.trim_end().lines().count() == 1, "{arguments}: {text}");
    }
    assert!(!place.path("out").exists());
}

#[test]
fn a_run_killed_at_any_moment_continues_to_the_same_bytes() {
    let place = place(6);
    let refine = |out: &str| format!("refine shots {MODEL} -o {out}");
    let course = Course::of(&place, &refine("whole"));
    let expected = all(&place.path("whole"));
    let (mut killed, mut kept, mut indexed) = (0, 0, 0);
    for moment in 0..MOMENTS {
        let out = format!("out{moment}");
        let jitter = (f64::from(moment) * 0.618_034).fract();
        let share = (f64::from(moment) + jitter) / f64::from(MOMENTS);
        let signal = if moment.is_multiple_of(3) { "-TERM" } else { "-KILL" };
        killed += u32::from(course.kill(&place, &refine(&out), share, signal));
        if place.path(&out).exists() {
            // What has its name is whole.
            let left = all(&place.path(&out));
            kept += left.len();
            for (name, maps) in &left {
                assert!(*maps == expected[name], "moment {moment}: {name}");
            }
            // The index names no photograph that is not finished; of a run that could end by itself, all that are.
            let listed = listed(&place.path(&out));
            assert!(listed.iter().all(|name| left.contains_key(name)), "moment {moment}: {listed:?}");
            indexed += listed.len();
            if signal == "-TERM" {
                assert_eq!(listed.len(), left.len(), "moment {moment}");
            }
        }
        place.mde(&refine(&out)).assert().success();
        assert!(all(&place.path(&out)) == expected, "moment {moment}: other bytes than an unbroken run's");
        assert_eq!(names(&place.path(&out)), names(&place.path("whole")), "moment {moment}");
    }
    assert!(killed >= MOMENTS / 4 && kept >= 2, "{killed} killed, {kept} kept");
    assert!(indexed > 0 && indexed < 6 * MOMENTS as usize, "{indexed} rows");
}

/// The folders of the photographs in `index.csv`, if there is one.
fn listed(folder: &Path) -> Vec<String> {
    let Ok(table) = fs::read_to_string(folder.join("index.csv")) else { return Vec::new() };
    let page = fs::read_to_string(folder.join("index.html")).unwrap_or_default();
    let folders: Vec<String> =
        table.lines().skip(1).map(|row| row.split(',').nth(1).unwrap().to_owned()).collect();
    // Written after the table: never more, and whole.
    assert!(page.is_empty() || page.ends_with("</html>\n"), "{page}");
    folders
}

#[test]
fn shards_and_a_plain_run_are_as_one_run() {
    let place = place(6);
    // Two photographs of one name, whose folders do not depend on the order of the arguments.
    fs::create_dir(place.path("more")).unwrap();
    fs::copy(place.path("shots/01.png"), place.path("more/00.png")).unwrap();
    let refine = format!("refine shots more {MODEL} -q");
    place.mde(&format!("{refine} -o whole")).assert().success();
    let expected = all(&place.path("whole"));
    assert_eq!(expected.len(), 7);
    for photographs in ["more shots", "shots more"] {
        // What a killed shard leaves.
        fs::create_dir_all(place.path("parts/.mde-left")).unwrap();
        let refine = refine.replace("shots more", photographs);
        for shard in ["2/3", "1/3"] {
            place.mde(&format!("{refine} --shard {shard} -o parts")).assert().success();
            assert!(!place.path("parts/index.csv").exists() || photographs == "shots more");
        }
        let finished = |text: &str| text.matches("finished before").count();
        let parts = all(&place.path("parts")).len();
        assert!(parts == 7 || (1..7).contains(&parts) && photographs == "more shots", "{parts}");
        // What is missing, and the index of all.
        let told = stderr(&place, &format!("{} -o parts", refine.replace(" -q", "")));
        assert_eq!(finished(&told), parts, "{told}");
    }
    assert!(all(&place.path("parts")) == expected);
    assert_eq!(rows(&place.path("parts")), rows(&place.path("whole")));
    assert_eq!(names(&place.path("parts")), names(&place.path("whole")));
}

/// A PNG with a colour profile of 256 MiB of zeros, deflated.
fn with_large_profile(png: &[u8]) -> Vec<u8> {
    let mut deflated = ZlibEncoder::new(b"iCCPzeros\0\0".to_vec(), Compression::new(6));
    let zeros = vec![0; 1 << 20];
    (0..256).for_each(|_| deflated.write_all(&zeros).unwrap());
    let chunk = deflated.finish().unwrap();
    let length = (chunk.len() as u32 - 4).to_be_bytes();
    // After the signature and the header.
    let (header, rest) = png.split_at(33);
    [header, &length, &chunk, &crc32fast::hash(&chunk).to_be_bytes(), rest].concat()
}

#[test]
fn compressed_metadata_take_little_memory() {
    let place = place(1);
    for name in ["shots/00.png", "truth.png"] {
        if name == "truth.png" {
            write_depth_png(place.path(name), place.scene.depth.view(), "m", 1000.0).unwrap();
        }
        let png = fs::read(place.path(name)).unwrap();
        place.write(name, with_large_profile(&png));
    }
    for (run, record) in [
        (format!("refine shots {MODEL} -o many"), "many/00/run.json"),
        (
            "refine image.png --prior-depth truth.png --gt truth.png --no-nerf --fov 60 -o one".to_owned(),
            "one/run.json",
        ),
    ] {
        place.mde(&run).assert().success();
        let record: Value = serde_json::from_str(&fs::read_to_string(place.path(record)).unwrap()).unwrap();
        let Some(peak) = record["peak_memory_bytes"].as_u64() else { continue };
        assert!(peak < 240 << 20, "{run}: {peak} bytes");
    }
}

/// The rows of an index without the seconds.
fn rows(folder: &Path) -> Value {
    let mut rows = index(folder)["photographs"].clone();
    rows.as_array_mut().unwrap().iter_mut().for_each(|row| row["seconds"] = 0.into());
    rows
}

#[test]
fn a_pattern_names_photographs_where_no_shell_expands_it() {
    let place = place(3);
    fs::write(place.path("shots/notes.txt"), "not a photograph").unwrap();
    fs::copy(place.path("shots/00.png"), place.path("=cmd.png")).unwrap();
    fs::write(place.path("list.txt"), "shots/0[12].png\n*.png\n").unwrap();
    let run =
        place.mde(&format!("refine shots/*0.png list.txt {MODEL} --log-json -o out")).assert().success();
    let rows = rows(&place.path("out"));
    let named: Vec<&str> =
        rows.as_array().unwrap().iter().map(|row| row["photograph"].as_str().unwrap()).collect();
    assert_eq!(named, ["shots/00.png", "shots/01.png", "shots/02.png", "=cmd.png", "image.png"]);
    // A spreadsheet runs no name.
    let table = fs::read_to_string(place.path("out/index.csv")).unwrap();
    assert!(table.contains("\n'=cmd.png,_cmd,"), "{table}");

    // Each photograph but the last has the time that is left.
    let log = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    let events = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let events: Vec<Value> = events.filter(|event| event["event"] == "photograph").collect();
    assert_eq!(events.len(), 5);
    for (done, event) in events.iter().enumerate() {
        assert_eq!((&event["done"], &event["all"]), (&(done + 1).into(), &5.into()));
        let left = event["seconds_left"].as_f64();
        // The mean time of those that are done, for each of the others.
        let most = event["seconds"].as_f64().unwrap() * (4 - done) as f64 / (done + 1) as f64;
        assert!(
            if done < 4 { left.is_some_and(|s| s > 0.0 && s <= most + 1e-3) } else { left.is_none() },
            "{event}"
        );
    }

    place.mde(&format!("refine shots/0.* {MODEL} -o none")).assert().code(1).stderr(
        predicate::str::contains("shots/0.*: no photograph (jpg")
            .and(predicate::function(|text: &str| text.trim_end().lines().count() == 1)),
    );
}

/// `burst/`: a room at four exposures, which the network takes for four depths, one of them cropped; and another room.
fn burst() -> Place {
    let place = place(0);
    fs::create_dir(place.path("burst")).unwrap();
    let write = |name: &str, image: ArrayView3<'_, f32>| {
        write_image(place.path(&format!("burst/{name}.png")), image).unwrap();
    };
    let scene = room(Room::ALL[0], 3, 224, 168).unwrap();
    for (name, gain) in [("a", 1.0), ("b", 0.8), ("c", 0.64)] {
        write(name, (&scene.image * gain).view());
    }
    write("d", (&scene.image.slice(s![14..154, 12..212, ..]) * 0.9).view());
    write("e", room(Room::ALL[1], 8, 224, 168).unwrap().image.view());
    place
}

#[test]
fn the_same_scale_is_found_recorded_and_resumed() {
    let place = burst();
    let refine = |more: &str, out: &str| format!("refine burst {MODEL} --predictions 1 {more} -o {out}");
    place.mde(&refine("", "plain")).assert().success();
    let same = "--same-scale";
    let run = place.mde(&refine(same, "out")).assert().success();
    let text = String::from_utf8(run.get_output().stderr.clone()).unwrap();
    assert!(text.contains("1 of 5 photographs: --same-scale: matches no other photograph"), "{text}");

    // The photographs of one room get the factors of their exposures, with a mean of 1. Cropped, with the same field of view, a room is
    // nearer.
    let rows = index(&place.path("out"))["photographs"].as_array().unwrap().clone();
    let factor = |i: usize| rows[i]["same_scale"].as_f64().unwrap();
    for (i, gain) in [(1, 0.8), (2, 0.64), (3, 0.9 * 224.0 / 200.0)] {
        let error = factor(i) / factor(0) * gain;
        assert!((error - 1.0).abs() < 0.04, "{i}: {error}");
    }
    assert!(((0..4).map(|i| factor(i).ln()).sum::<f64>()).abs() < 1e-9);
    let groups: Vec<u64> = rows.iter().map(|row| row["same_scale_group"].as_u64().unwrap()).collect();
    assert_eq!((groups, factor(4)), (vec![0, 0, 0, 0, 1], 1.0));
    let table = fs::read_to_string(place.path("out/index.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with(",same_scale,same_scale_sigma,same_scale_group"));

    // The maps are those without the flag, times the factor.
    for (i, name) in ["a", "b", "c", "d", "e"].iter().enumerate() {
        let map =
            |out: &str| read_values(place.path(&format!("{out}/{name}/depth.npy")), &ReadOptions::default());
        for (scaled, plain) in map("out").unwrap().iter().zip(&map("plain").unwrap()) {
            assert!((f64::from(*scaled) - factor(i) * f64::from(*plain)).abs() <= 1e-5 * f64::from(*scaled));
        }
        let record = fs::read_to_string(place.path(&format!("out/{name}/run.json"))).unwrap();
        let found = serde_json::from_str::<Value>(&record).unwrap()["same_scale"].clone();
        assert!((found["factor"].as_f64().unwrap() / factor(i) - 1.0).abs() < 1e-12);
        assert_eq!(found["photographs"].as_u64(), Some(if i < 4 { 4 } else { 1 }));
        assert_eq!(found["log_sigma"].as_f64().unwrap() > 0.0, i < 4);
    }

    // One thread, shards, and a run that is continued have the same bytes.
    let expected = all(&place.path("out"));
    place.mde(&refine("--same-scale --threads 1 -q", "one")).assert().success();
    assert!(all(&place.path("one")) == expected);
    for shard in ["1/2", "2/2"] {
        place.mde(&refine(&format!("--same-scale -q --shard {shard}"), "parts")).assert().success();
    }
    assert!(all(&place.path("parts")) == expected);
    fs::remove_file(place.path("out/b/finished.json")).unwrap();
    let again = place.mde(&refine(same, "out")).assert().success();
    again.stdout(predicate::str::contains("1 refined, 4 finished before"));
    assert!(all(&place.path("out")) == expected);

    // One that can't be read is a row; without another the factors are others, and only they are refined again.
    fs::write(place.path("burst/c.png"), "no picture").unwrap();
    place
        .mde(&refine(same, "out"))
        .assert()
        .code(3)
        .stdout(predicate::str::contains("3 refined, 1 finished before, 1 failed"));
}
