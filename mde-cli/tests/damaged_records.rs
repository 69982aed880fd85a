//! Records of shards as a killed job, a full disk or an editor may leave them: `mde merge` joins them or refuses in one line, and
//! writes nowhere but in its output. `PROPTEST_CASES` sets their number.
#![allow(clippy::unwrap_used)]

mod common;

use common::{Place, copy};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, TestRunner};
use serde_json::Value;
use std::cell::Cell;
use std::fs;

const VALUES: [&str; 14] = [
    "null",
    "true",
    "-1",
    "0",
    "0.5",
    "1e300",
    "4294967295",
    "18446744073709551615",
    "\"\"",
    "\"..\"",
    "\"../thesis.txt\"",
    "\"/\"",
    "[]",
    "{}",
];

#[derive(Debug, Clone)]
enum Damage {
    /// A value in the place of another.
    Value(Index, Index),
    /// The value at one place also at another.
    Copied(Index, Index),
    Bytes(Vec<(Index, u8)>),
    Cut(Index),
    Inserted(Index, Vec<u8>),
}

fn damages() -> impl Strategy<Value = Damage> {
    let place = any::<Index>;
    prop_oneof![
        4 => (place(), place()).prop_map(|(at, value)| Damage::Value(at, value)),
        2 => (place(), place()).prop_map(|(from, to)| Damage::Copied(from, to)),
        2 => prop::collection::vec((place(), any::<u8>()), 1..4).prop_map(Damage::Bytes),
        1 => place().prop_map(Damage::Cut),
        1 => (place(), prop::collection::vec(any::<u8>(), 1..4)).prop_map(|(at, new)| Damage::Inserted(at, new)),
    ]
}

/// JSON pointers of all values.
fn places(value: &Value, at: &str, found: &mut Vec<String>) {
    found.push(at.to_owned());
    match value {
        Value::Array(values) => {
            values.iter().enumerate().for_each(|(key, inner)| places(inner, &format!("{at}/{key}"), found));
        }
        Value::Object(map) => map.iter().for_each(|(key, inner)| {
            places(inner, &format!("{at}/{}", key.replace('~', "~0").replace('/', "~1")), found);
        }),
        _ => {}
    }
}

fn damaged(text: &[u8], damage: &Damage) -> Vec<u8> {
    let mut bytes = text.to_vec();
    let mut value: Value = serde_json::from_slice(text).unwrap();
    let mut all = Vec::new();
    places(&value, "", &mut all);
    match damage {
        Damage::Value(at, new) => {
            let new = serde_json::from_str(VALUES[new.index(VALUES.len())]).unwrap();
            *value.pointer_mut(&all[at.index(all.len())]).unwrap() = new;
            bytes = serde_json::to_vec(&value).unwrap();
        }
        Damage::Copied(from, to) => {
            let copied = value.pointer(&all[from.index(all.len())]).unwrap().clone();
            *value.pointer_mut(&all[to.index(all.len())]).unwrap() = copied;
            bytes = serde_json::to_vec(&value).unwrap();
        }
        Damage::Bytes(new) => new.iter().for_each(|(at, byte)| {
            let at = at.index(bytes.len());
            bytes[at] = *byte;
        }),
        Damage::Cut(at) => bytes.truncate(at.index(bytes.len())),
        Damage::Inserted(at, new) => {
            let at = at.index(bytes.len());
            bytes.splice(at..at, new.iter().copied());
        }
    }
    bytes
}

/// Merges with one record damaged. Whole ones come out, or an error that names what is wrong; nothing else is written.
fn merge_damaged(shards: &Place, records: &[&'static str], written: &str, cases: u32) {
    let mut runner = TestRunner::new(Config { failure_persistence: None, ..Config::with_cases(cases) });
    let damaged_record = (prop::sample::select(records.to_vec()), damages());
    let (joined, refused) = (Cell::new(0), Cell::new(0));
    let outcome = runner.run(&damaged_record, |(record, damage)| {
        let place = Place::empty();
        place.write("thesis.txt", "years");
        copy(&shards.path("parts"), &place.path("parts"));
        let path = place.path("parts").join(record);
        fs::write(&path, damaged(&fs::read(&path).unwrap(), &damage)).unwrap();
        let done = place.mde("merge parts -q -o out").output().unwrap();
        let told = String::from_utf8_lossy(&done.stderr).into_owned();
        match done.status.code() {
            Some(0) => joined.set(joined.get() + 1),
            // A photograph or a scene failed.
            Some(3) => prop_assert!(place.path("out").join(written).is_file(), "{told}"),
            Some(1) => {
                refused.set(refused.get() + 1);
                prop_assert!(
                    told.lines().count() == 1 && told.len() < 2000 && told.contains("parts"),
                    "{told}"
                );
                prop_assert!(!place.path("out").join(written).exists(), "{told}");
            }
            other => prop_assert!(false, "{other:?}: {told}"),
        }
        let mut names = place.entries();
        names.retain(|name| name != "out");
        prop_assert_eq!(names, ["parts", "thesis.txt"]);
        prop_assert_eq!(fs::read_to_string(place.path("thesis.txt")).unwrap(), "years");
        Ok(())
    });
    outcome.unwrap();
    assert!(joined.get() > 0 && refused.get() > 0, "{} joined, {} refused", joined.get(), refused.get());
}

/// Overridden by `PROPTEST_CASES`.
fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES").ok().and_then(|number| number.parse().ok()).unwrap_or(usual)
}

#[test]
#[cfg(feature = "onnx")]
fn damaged_records_of_photographs_are_joined_or_refused() {
    let place = Place::new();
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    fs::copy(fixtures.join("grey_nchw.onnx"), place.path("grey.onnx")).unwrap();
    fs::copy(place.path("image.png"), place.path("b.png")).unwrap();
    let refine = "refine image.png b.png --prior-model grey.onnx --model-profile fastdepth --predictions 1 --fov 60 -q";
    for shard in 1..=2 {
        place.mde(&format!("{refine} --shard {shard}/2 -o parts")).assert().success();
    }
    let records = ["shard-1-of-2.json", "shard-2-of-2.json", "image/finished.json", "b/finished.json"];
    merge_damaged(&place, &records, "index.json", cases(48));
}

#[test]
fn damaged_records_of_scenes_are_joined_or_refused() {
    let place = Place::empty();
    for shard in 1..=2 {
        let eval = "eval --dataset rooms --size 32x24 --limit 4 --methods guided -q";
        place.mde(&format!("{eval} --shard {shard}/2 -o parts")).assert().success();
    }
    let records = ["eval-shard-1-of-2.json", "eval-shard-2-of-2.json", "eval.json"];
    merge_damaged(&place, &records, "table.md", cases(16));
}
