//! Whenever a run is killed, its output is the old one or the new one; an evaluation continues to the same bytes.

use crate::common::{Course, Place, REFINE, copy, names, send, tiny};
use glob::glob;
use mde_cli::mde_prior::format::{ReadOptions, read_values};
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const MOMENTS: u32 = 12;
const SIGNALS: [&str; 4] = ["KILL", "TERM", "KILL", "QUIT"];

#[test]
fn a_refinement_killed_at_any_moment_leaves_old_or_new() {
    let place = Place::new();
    place.write("tiny.toml", tiny(&[("iterations = 2", "iterations = 4"), ("steps = 60", "steps = 20")]));
    let refine = format!("{REFINE} --force");
    place.run(&format!("{refine} --seed 7 -o old"));
    let course = Course::of(&place, &format!("{refine} -o new"));
    let maps =
        |folder: &str| ["depth", "sigma", "prior"].map(|map| place.bytes(&format!("{folder}/{map}.npy")));
    let (old, new) = (maps("old"), maps("new"));
    assert!(old != new);
    let mut killed = 0;
    for moment in 0..MOMENTS {
        copy(&place.path("old"), &place.path("out"));
        let signal = SIGNALS[moment as usize % 4];
        killed += u32::from(course.kill(&place, &format!("{refine} -o out"), moment, MOMENTS, signal));
        let left = maps("out");
        assert!(left == old || left == new, "moment {moment}: neither the old maps nor the new ones");
        assert_eq!(names(&place.path("out")), names(&place.path("old")), "moment {moment}");
        fs::remove_dir_all(place.path("out")).unwrap();
    }
    assert!(killed >= MOMENTS / 4, "{killed} killed");
}

/// Each signal that a program can handle, as soon as the results are being written.
#[test]
fn an_interrupted_run_leaves_no_unfinished_files() {
    let place = Place::new();
    let unfinished = || place.entries().iter().any(|name| name.starts_with(".mde-"));
    place.write("long.toml", tiny(&[("steps = 60", "steps = 1000000")]));
    place.write("tiny.toml", tiny(&[("steps = 60", "steps = 5")]));
    let before = place.entries();
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        // A run may be finished before the signal arrives.
        let interrupted = (0..20).any(|_| {
            let mut child = place.start(&format!("{REFINE} --export ply,glb,exr,colmap,sigma -o out"));
            while !unfinished() && child.try_wait().unwrap().is_none() {
                sleep(Duration::from_millis(1));
            }
            send(&child, signal);
            let status = child.wait().unwrap();
            let _ = fs::remove_dir_all(place.path("out"));
            assert_eq!(place.entries(), before, "{signal}, {status}");
            status.code() == Some(130)
        });
        assert!(interrupted, "{signal} never ended a run with exit code 130");
    }
    // Nor, in a long fit, the folders above its output.
    for signal in ["INT", "TERM"] {
        let mut run = Command::new(env!("CARGO_BIN_EXE_mde"))
            .current_dir(place.path("."))
            .args(REFINE.replace("tiny", "long").split(' '))
            .args(["-o", "a/b/out"])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(run.stderr.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains("fit")));
        let begin = Instant::now();
        send(&run, signal);
        assert_eq!(run.wait().unwrap().code(), Some(130));
        assert!(begin.elapsed() < Duration::from_secs(60));
        assert!(lines.any(|line| line.contains("interrupted")) && place.entries() == before);
    }
}

/// All maps of an evaluation; each entry that is there is whole.
fn entries(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    // A scene's folder holds its picture too.
    let entries = glob(&format!("{}/scenes/[!.]*/[!.]*", root.display())).unwrap().map(Result::unwrap);
    for entry in entries.filter(|path| path.is_dir()) {
        let record = fs::read_to_string(entry.join("method.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&record).unwrap();
        for name in ["depth.npy", "sigma.npy"] {
            let path = entry.join(name);
            if name == "depth.npy" || path.exists() {
                assert_eq!(read_values(&path, &ReadOptions::default()).unwrap().dim(), (48, 64));
                found.insert(path.strip_prefix(root).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

#[test]
fn an_evaluation_killed_at_any_moment_resumes_to_the_same_bytes() {
    let place = Place::new();
    place.write("short.toml", tiny(&[("steps = 60", "steps = 10"), ("iterations = 2", "iterations = 1")]));
    let eval = "eval --dataset rooms --size 64x48 --limit 2 --methods guided,short.toml";
    let course = Course::of(&place, &format!("{eval} -o whole"));
    let expected = entries(&place.path("whole"));
    assert!(expected.len() >= 8);
    let mut killed = 0;
    for moment in 0..MOMENTS {
        let root = place.path(&format!("e{moment}"));
        let again = format!("{eval} -o e{moment}");
        killed += u32::from(course.kill(&place, &again, moment, MOMENTS, SIGNALS[moment as usize % 4]));
        for (name, bytes) in entries(&root) {
            assert!(expected[&name] == bytes, "moment {moment}: {}", name.display());
        }
        for name in ["summary.json", "eval.json"] {
            if let Ok(text) = fs::read_to_string(root.join(name)) {
                serde_json::from_str::<serde_json::Value>(&text).unwrap();
            }
        }
        place.run(&again);
        assert!(entries(&root) == expected, "moment {moment}: other bytes than an unbroken run's");
        assert_eq!(names(&root), names(&place.path("whole")), "moment {moment}");
    }
    assert!(killed >= MOMENTS / 4, "{killed} killed");
}
