//! `mde eval --shard` and `mde merge`.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, copy, names};
use predicates::prelude::*;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// One method fails on every scene, as the simulated prior accepts no crops.
const EVAL: &str = "eval --dataset rooms --size 64x48 --limit 5 --methods tiny.toml,guided,zoom -q";

fn eval(place: &Place, rest: &str) -> assert_cmd::assert::Assert {
    place.mde(&format!("{EVAL} {rest}")).assert()
}

/// The rows of `scenes.csv` without the seconds.
fn rows(folder: &Path) -> Vec<Vec<String>> {
    let mut reader = csv_rows(&fs::read_to_string(folder.join("scenes.csv")).unwrap());
    let seconds = reader[0].iter().position(|name| name == "seconds").unwrap();
    reader.iter_mut().for_each(|row| drop(row.remove(seconds)));
    reader
}

/// Fields of lines; no name in these tests has a comma but those in quotes.
fn csv_rows(text: &str) -> Vec<Vec<String>> {
    let fields = |line: &str| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for character in line.chars() {
            match character {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                other => fields.last_mut().unwrap().push(other),
            }
        }
        fields
    };
    text.lines().map(fields).collect()
}

fn summary(folder: &Path) -> Value {
    let mut summary: Value = serde_json::from_slice(&fs::read(folder.join("summary.json")).unwrap()).unwrap();
    summary.as_object_mut().unwrap().remove("command_line");
    summary
}

#[test]
fn merged_shards_are_the_whole_evaluation() {
    let place = Place::new();
    eval(&place, "-o whole").code(3);
    let scenes = names(&place.path("whole/scenes"));
    assert_eq!(scenes.len(), 5);

    // In one folder and in two, computed anew: the same numbers to the last bit.
    for shard in ["1/2", "2/2"] {
        eval(&place, &format!("--shard {shard} -o one")).code(3);
        let part = shard.replace('/', "-of-");
        eval(&place, &format!("--shard {shard} -o part-{part}")).code(3);
        assert!(!place.path("one/table.md").exists());
    }
    place.mde("merge one -q").assert().code(3);
    place.mde("merge part-2-of-2 part-1-of-2 -o two -q").assert().code(3);
    for folder in ["one", "two"] {
        assert_eq!(rows(&place.path(folder)), rows(&place.path("whole")), "{folder}");
        assert_eq!(names(&place.path(&format!("{folder}/scenes"))), scenes);
        for scene in &scenes {
            let map = |folder: &str| {
                fs::read(place.path(&format!("{folder}/scenes/{scene}/tiny/depth.npy"))).unwrap()
            };
            assert!(map(folder) == map("whole"), "{folder} {scene}");
        }
    }

    // From the whole one's maps, with their times: all files are the same, but for the command line. The whole evaluation runs again too,
    // as its scores are read from their files then.
    eval(&place, "-o whole").code(3);
    copy(&place.path("whole/scenes"), &place.path("kept/scenes"));
    fs::copy(place.path("whole/eval.json"), place.path("kept/eval.json")).unwrap();
    for shard in ["3/3", "1/3", "2/3"] {
        // One of these has no scene.
        eval(&place, &format!("--shard {shard} -o kept")).code(predicate::in_iter([0, 3]));
    }
    place.mde("merge kept -q").assert().code(3);
    assert_eq!(summary(&place.path("kept")), summary(&place.path("whole")));
    let mut files = names(&place.path("whole"));
    files.retain(|name| !["scenes", "summary.json", "report.html"].contains(&&**name));
    assert!(
        files.contains(&"table.md".to_owned()) && files.contains(&"reliability.svg".to_owned()),
        "{files:?}"
    );
    for file in files {
        let bytes = |folder: &str| fs::read(place.path(folder).join(&file)).unwrap();
        assert!(bytes("kept") == bytes("whole"), "{file}");
    }
    // The page has the command line of the summary.
    let page = |folder: &str| {
        let text = fs::read_to_string(place.path(folder).join("report.html")).unwrap();
        let summary: Value =
            serde_json::from_slice(&fs::read(place.path(folder).join("summary.json")).unwrap()).unwrap();
        text.replace(summary["command_line"].as_str().unwrap(), "")
    };
    assert!(page("kept") == page("whole"));
}

#[test]
fn a_shard_that_is_missing_double_or_different_is_named() {
    let place = Place::new();
    let rooms = "eval --dataset rooms --size 64x48 --limit 3 --methods guided -q";
    for shard in ["1/2", "2/2"] {
        place.mde(&format!("{rooms} --shard {shard} -o e")).assert().success();
    }
    let refused = |command: &str, part: &str| {
        place.mde(command).assert().code(1).stderr(predicate::str::contains(part.to_owned()));
    };
    copy(&place.path("e"), &place.path("f"));
    refused("merge e f -o g", "shard 1/2 is double");
    fs::remove_file(place.path("f/eval-shard-1-of-2.json")).unwrap();
    refused("merge f", "shards 1 of 2 are missing; run mde eval --shard I/2");
    place.mde(&format!("{rooms} --shard 1/2 -o h --alignment none")).assert().success();
    refused("merge f h -o g", "other settings than the first");
    place.mde(&format!("{} --shard 1/2 -o i", rooms.replace("limit 3", "limit 4"))).assert().success();
    refused("merge f i -o g", "other scenes than the first");
    let gone = names(&place.path("e/scenes")).remove(0);
    fs::remove_dir_all(place.path("e/scenes").join(gone)).unwrap();
    refused("merge e", "is missing; run its shard again");
    refused(&format!("{rooms} --shard 1/2 -o e --force"), "other shards");
    assert!(!place.path("g").exists());
    // A shard that runs again counts only once it is done.
    fs::write(place.path("e/eval-shard-2-of-2.json"), "{}").unwrap();
    refused("merge e", "is no shard of an evaluation");
    for shard in ["1/2", "2/2"] {
        place.mde(&format!("{rooms} --shard {shard} -o e")).assert().success();
    }
    place.mde("merge e -q").assert().success();
    assert!(place.path("e/report.html").exists());
}
