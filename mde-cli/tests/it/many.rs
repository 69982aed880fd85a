//! `mde refine` on many photographs: each as a run of its own would have it, resumed after a kill, in shards.

use crate::common::{Place, finished, fixture, names};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use mde_cli::mde_prior::format::write_depth_png;
use mde_eval::scene::{Room, room};
use ndarray::s;
use serde_json::Value;
use std::fs;
use std::io::Write;

const MODEL: &str = "--prior-model grey.onnx --model-profile fastdepth --fov 60";

/// `shots/` with photographs of rooms, and `grey.onnx`: depth by the brightness.
fn place(count: usize) -> Place {
    let place = Place::new();
    for seed in 0..count {
        let scene = room(Room::ALL[seed % Room::ALL.len()], seed as u64, 64, 48).unwrap();
        place.photograph(&format!("shots/{seed:02}.png"), scene.image.view());
    }
    place.take(fixture("grey_nchw.onnx"), "grey.onnx");
    place
}

fn folders(place: &Place, out: &str) -> Vec<String> {
    let folders = place.below(out, "*/");
    folders.map(|folder| folder.file_name().unwrap().to_str().unwrap().to_owned()).collect()
}

/// The rows of an index without the seconds.
fn rows(place: &Place, out: &str) -> Vec<Value> {
    let mut rows = place.json(&format!("{out}/index.json"))["photographs"].as_array().unwrap().clone();
    rows.iter_mut().for_each(|row| row["seconds"] = 0.into());
    rows
}

#[test]
fn each_photograph_is_as_a_run_of_its_own_has_it() {
    let place = place(4);
    let refine = format!("refine shots {MODEL} --interval 0.8 -o out");
    place.prints(&refine, 0, "lower.npy and upper.npy in each folder: 80 % interval\nwrote ");
    let found = place.maps("out");
    let page = place.text("out/index.html");
    for name in ["00", "01", "02", "03"] {
        place.run(&format!("refine shots/{name}.png {MODEL} --interval 0.8 -q -o one/{name}"));
        let config = |folder: &str| place.text(&format!("{folder}/{name}/config.toml"));
        assert_eq!(config("out"), config("one"));
        let links = [format!("href=\"{name}/report.html\""), format!("src=\"{name}/thumbnail.png\"")];
        assert!(links.iter().all(|link| page.contains(link)), "{name}");
    }
    assert!(found == place.maps("one") && found.contains_key("03/upper.npy"));
    let table = place.text("out/index.csv");
    assert_eq!((table.lines().count(), table.matches(",done,").count()), (5, 4));
    let row = &rows(&place, "out")[0];
    assert!(row["width"] == 64 && row["camera"] == "field-of-view", "{row}");
    assert!(row["sigma"].as_f64().unwrap() > 0.0 && row["median_depth"].as_f64().unwrap() > 0.0);

    // Emptied, cut or removed maps are made again.
    place.write("out/00/depth.npy", "");
    let cut = &found["01/sigma.npy"];
    place.write("out/01/sigma.npy", &cut[..cut.len() / 2]);
    fs::remove_file(place.path("out/02/depth.npy")).unwrap();
    place.prints(&refine, 0, "3 refined, 1 finished before");
    assert!(place.maps("out") == found);

    // Again: nothing to do. One changed, one more, one gone, other settings: as much as that.
    assert_eq!(finished(&place.run(&refine)), 4);
    place.take("shots/03.png", "shots/01.png");
    fs::rename(place.path("shots/02.png"), place.path("shots/09.png")).unwrap();
    assert_eq!(finished(&place.run(&refine)), 2);
    let again = place.maps("out");
    for (now, before) in [("00", "00"), ("01", "03"), ("09", "02")] {
        let same = |map: &str| again[&format!("{now}/{map}.npy")] == found[&format!("{before}/{map}.npy")];
        assert!(["depth", "sigma", "prior"].into_iter().all(same), "{now}");
    }
    assert_eq!(rows(&place, "out").len(), 4);
    assert_eq!(finished(&place.run(&format!("{refine} --seed 5"))), 0);
    // A calibration counts by its values.
    let usual = include_str!("../../src/refiner/calibration/default.toml");
    let changed = usual.replace("0.007289", "0.007290");
    assert_ne!(usual, changed);
    let kept = [usual.to_owned(), format!("{usual}# a comment\n"), changed].map(|text| {
        place.write("c.toml", text);
        finished(&place.run(&format!("{refine} --seed 5 --calibration c.toml")))
    });
    assert_eq!(kept, [0, 4, 0]);
}

#[test]
fn what_fails_is_a_row_and_the_others_are_refined() {
    let place = place(2);
    place.take("shots/00.png", "other/00.PNG");
    place.take("shots/00.png", "odd , name?.png");
    place.write("shots/broken.jpg", "no picture");
    place.write("shots/notes.txt", "not a photograph");
    place.write("list.txt", "# more\nodd , name?.png\nabsent.png\n");
    // Names twice, names that collide, a list.
    let run = format!("refine shots shots/01.png other list.txt {MODEL} -o out");
    let words = "2 of the runs failed ; 6 photographs: 4 refined, 0 finished before, 2 failed";
    place.prints(&run, 3, words);
    let rows = rows(&place, "out");
    let failed = rows.iter().filter_map(|row| Some([row["photograph"].as_str()?, row["error"].as_str()?]));
    let [[broken, unreadable], [absent, missing]] = failed.collect::<Vec<_>>().try_into().unwrap();
    assert_eq!([broken, absent], ["shots/broken.jpg", "absent.png"]);
    assert!(unreadable.contains("no readable image") && missing.contains("no such photograph"), "{rows:?}");
    assert_eq!(folders(&place, "out"), ["00", "00_2", "01", "odd___name_"]);
    // Mended, it is refined; the others are kept.
    place.take("shots/01.png", "shots/broken.jpg");
    place.take("shots/01.png", "absent.png");
    place.prints(&run, 0, "2 refined, 4 finished before");
    let mut piped = place.mde(&format!("refine - {MODEL} -o piped"));
    let piped = piped.write_stdin("shots/00.png\n\nshots/01.png\n").assert().success();
    let said = String::from_utf8_lossy(&piped.get_output().stdout).into_owned();
    assert!(said.contains("2 photographs: 2 refined"), "{said}");
}

#[test]
fn a_run_killed_at_any_moment_continues_to_the_same_bytes() {
    let place = place(4);
    let refine = format!("refine shots {MODEL}");
    let (mut kept, mut indexed) = (0, 0);
    place.kill_at_moments(&refine, 8, &["TERM", "KILL", "KILL"], |out, signal| {
        if place.has(out) {
            let left = folders(&place, out);
            kept += left.len();
            // What has its name is whole.
            for name in &left {
                let maps = |folder: &str| place.maps(&format!("{folder}/{name}"));
                assert!(maps(out) == maps("whole"), "{out}: {name}");
            }
            // The index names no photograph that is not finished; of a run that could end by itself, all that are.
            let listed = listed(&place, out);
            assert!(listed.iter().all(|name| left.contains(name)), "{out}: {listed:?}");
            assert!(signal == "KILL" || listed.len() == left.len(), "{out}: {listed:?}");
            indexed += listed.len();
        }
        place.run(&format!("{refine} -o {out}"));
        assert!(place.maps(out) == place.maps("whole"), "{out}: other bytes than an unbroken run's");
        assert_eq!(names(&place.path(out)), names(&place.path("whole")), "{out}");
    });
    assert!(kept >= 2 && indexed > 0 && indexed < 32, "{kept} kept, {indexed} rows");
}

/// The folders of the photographs in `index.csv`, if there is one.
fn listed(place: &Place, out: &str) -> Vec<String> {
    let Ok(table) = fs::read_to_string(place.path(out).join("index.csv")) else { return Vec::new() };
    let page = fs::read_to_string(place.path(out).join("index.html")).unwrap_or_default();
    // Written after the table: never more, and whole.
    assert!(page.is_empty() || page.ends_with("</html>\n"), "{page}");
    table.lines().skip(1).map(|row| row.split(',').nth(1).unwrap().to_owned()).collect()
}

#[test]
fn shards_and_a_plain_run_are_as_one_run() {
    let place = place(6);
    // Two photographs of one name, whose folders do not depend on the order of the arguments.
    place.take("shots/01.png", "more/00.png");
    let refine = |photographs: &str, more: &str| format!("refine {photographs} {MODEL} {more}");
    place.run(&refine("shots more", "-q -o whole"));
    assert_eq!(folders(&place, "whole").len(), 7);
    for photographs in ["more shots", "shots more"] {
        // What a killed shard leaves.
        fs::create_dir_all(place.path("parts/.mde-left")).unwrap();
        for shard in ["2/3", "1/3"] {
            place.run(&refine(photographs, &format!("-q --shard {shard} -o parts")));
            assert!(!place.has("parts/index.csv") || photographs == "shots more");
        }
        let parts = folders(&place, "parts").len();
        assert!(parts == 7 || (1..7).contains(&parts) && photographs == "more shots", "{parts}");
        // What is missing, and the index of all.
        assert_eq!(finished(&place.run(&refine(photographs, "-o parts"))), parts);
    }
    assert!(place.maps("parts") == place.maps("whole"));
    assert_eq!(rows(&place, "parts"), rows(&place, "whole"));
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
    write_depth_png(place.path("truth.png"), place.scene.depth.view(), "m", 1000.0).unwrap();
    for name in ["shots/00.png", "truth.png"] {
        place.write(name, with_large_profile(&place.bytes(name)));
    }
    let map = "--prior-depth truth.png --gt truth.png --no-nerf --fov 60 -o one";
    for (run, folder) in
        [(format!("refine shots {MODEL} -o many"), "many/00"), (format!("refine image.png {map}"), "one")]
    {
        place.run(&run);
        let Some(peak) = place.record(folder)["peak_memory_bytes"].as_u64() else { continue };
        assert!(peak < 240 << 20, "{run}: {peak} bytes");
    }
}

#[test]
fn a_pattern_names_photographs_where_no_shell_expands_it() {
    let place = place(3);
    place.write("shots/notes.txt", "not a photograph");
    place.write("list.txt", "shots/0[12].png\nima*.png\n");
    let log = place.run(&format!("refine shots/*0.png list.txt {MODEL} --log-json -o many"));
    let rows = rows(&place, "many");
    let named: Vec<&str> = rows.iter().map(|row| row["photograph"].as_str().unwrap()).collect();
    assert_eq!(named, ["shots/00.png", "shots/01.png", "shots/02.png", "image.png"]);

    // Each photograph but the last has the time that is left.
    let events = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let events: Vec<Value> = events.filter(|event| event["event"] == "photograph").collect();
    assert_eq!(events.len(), 4);
    for (done, event) in events.iter().enumerate() {
        assert!(event["done"] == done + 1 && event["all"] == 4, "{event}");
        let left = event["seconds_left"].as_f64();
        // The mean time of those that are done, for each of the others.
        let most = event["seconds"].as_f64().unwrap() * (3 - done) as f64 / (done + 1) as f64;
        let fits = left.is_some_and(|seconds| seconds > 0.0 && seconds <= most + 1e-3);
        assert!(if done < 3 { fits } else { left.is_none() }, "{event}");
    }
    place.refused(&format!("refine shots {MODEL}"), "-o: give a folder");
}

/// `burst/`: a room at four exposures, which the network takes for four depths, one of them cropped; and another room.
fn burst() -> Place {
    let place = place(0);
    let scene = room(Room::ALL[0], 3, 224, 168).unwrap();
    for (name, gain) in [("a", 1.0), ("b", 0.8), ("c", 0.64)] {
        place.photograph(&format!("burst/{name}.png"), (&scene.image * gain).view());
    }
    place.photograph("burst/d.png", (&scene.image.slice(s![14..154, 12..212, ..]) * 0.9).view());
    place.photograph("burst/e.png", room(Room::ALL[1], 8, 224, 168).unwrap().image.view());
    place
}

#[test]
fn the_same_scale_is_found_recorded_and_resumed() {
    let place = burst();
    let refine = |more: &str, out: &str| format!("refine burst {MODEL} --predictions 1 {more} -o {out}");
    place.prints(&refine("", "plain"), 0, "the first two show one place: mde dense");
    let same = refine("--same-scale", "out");
    place.prints(&same, 0, "1 of 5 photographs: --same-scale: matches no other photograph");

    // Photographs of one room get the factors of their exposures, with a mean of 1. Cropped with the same field of view, it is nearer.
    let rows = rows(&place, "out");
    let factor = |i: usize| rows[i]["same_scale"].as_f64().unwrap();
    for (i, gain) in [(1, 0.8), (2, 0.64), (3, 0.9 * 224.0 / 200.0)] {
        let error = factor(i) / factor(0) * gain;
        assert!((error - 1.0).abs() < 0.04, "{i}: {error}");
    }
    assert!(((0..4).map(|i| factor(i).ln()).sum::<f64>()).abs() < 1e-9);
    let groups: Vec<u64> = rows.iter().map(|row| row["same_scale_group"].as_u64().unwrap()).collect();
    assert_eq!((groups, factor(4)), (vec![0, 0, 0, 0, 1], 1.0));
    let table = place.text("out/index.csv");
    assert!(table.lines().next().unwrap().ends_with(",same_scale,same_scale_sigma,same_scale_group"));

    // The maps are those without the flag, times the factor.
    for (i, name) in ["a", "b", "c", "d", "e"].iter().enumerate() {
        let map = |out: &str| place.map(&format!("{out}/{name}/depth.npy"));
        for (scaled, plain) in map("out").iter().zip(&map("plain")) {
            assert!((f64::from(*scaled) - factor(i) * f64::from(*plain)).abs() <= 1e-5 * f64::from(*scaled));
        }
        let found = place.record(&format!("out/{name}"))["same_scale"].clone();
        assert!((found["factor"].as_f64().unwrap() / factor(i) - 1.0).abs() < 1e-12);
        assert_eq!(found["photographs"].as_u64(), Some(if i < 4 { 4 } else { 1 }));
        assert_eq!(found["log_sigma"].as_f64().unwrap() > 0.0, i < 4);
    }

    // Shards on one thread, and a run that is continued, have the same bytes.
    let expected = place.maps("out");
    for shard in ["1/2", "2/2"] {
        place.run(&refine(&format!("--same-scale --threads 1 -q --shard {shard}"), "parts"));
    }
    assert!(place.maps("parts") == expected);
    fs::remove_file(place.path("out/b/finished.json")).unwrap();
    place.prints(&same, 0, "1 refined, 4 finished before");
    assert!(place.maps("out") == expected);

    // One that can't be read is a row; without another the factors are others, and only they are refined again.
    place.write("burst/c.png", "no picture");
    place.prints(&same, 3, "3 refined, 1 finished before, 1 failed");
}
