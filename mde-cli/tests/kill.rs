//! Whenever a run is killed, its output is the old one or the new one; an evaluation continues to the same bytes.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod common;

use common::{Course, Place, TINY, names};
use mde_cli::mde_prior::format::{ReadOptions, read_values};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

const MOMENTS: u32 = 12;
const MAPS: [&str; 3] = ["depth.npy", "sigma.npy", "prior.npy"];

fn start(place: &Place, arguments: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_mde"))
        .current_dir(place.path("."))
        .args(arguments.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Kills at one of the moments, spread over a whole run; whether it was still going.
fn kill_at(place: &Place, arguments: &str, moment: u32, course: &Course) -> bool {
    // Not at equal steps: a fraction that has no period in common with the stages.
    let jitter = (f64::from(moment) * 0.618_034).fract();
    let share = (f64::from(moment) + jitter) / f64::from(MOMENTS);
    course.kill(place, arguments, share, ["-KILL", "-TERM", "-KILL", "-QUIT"][moment as usize % 4])
}

fn maps(folder: &Path) -> [Vec<u8>; 3] {
    MAPS.map(|name| fs::read(folder.join(name)).unwrap())
}

/// All maps of an evaluation; each entry that is there is whole.
fn entries(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let visible = |folder: &Path| -> Vec<PathBuf> {
        let inside = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        inside.filter(|path| !path.file_name().unwrap().to_string_lossy().starts_with('.')).collect()
    };
    // A scene's folder holds its picture too.
    let entries = visible(&root.join("scenes"))
        .into_iter()
        .flat_map(|scene| visible(&scene))
        .filter(|path| path.is_dir());
    for entry in entries {
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
fn a_refinement_killed_at_any_moment_leaves_old_or_new() {
    let place = Place::new();
    place.write(
        "four.toml",
        TINY.replace("iterations = 2", "iterations = 4").replace("steps = 60", "steps = 20"),
    );
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config four.toml --force";
    place.mde(&format!("{refine} --seed 7 -o old")).assert().success();
    let course = Course::of(&place, &format!("{refine} -o new"));
    let (old, new) = (maps(&place.path("old")), maps(&place.path("new")));
    assert!(old != new);

    let mut killed = 0;
    for moment in 0..MOMENTS {
        let out = format!("out{moment}");
        fs::create_dir(place.path(&out)).unwrap();
        for name in names(&place.path("old")) {
            fs::copy(place.path("old").join(&name), place.path(&out).join(&name)).unwrap();
        }
        let again = format!("{refine} -o {out}");
        killed += u32::from(kill_at(&place, &again, moment, &course));
        let left = maps(&place.path(&out));
        assert!(left == old || left == new, "moment {moment}: neither the old maps nor the new ones");
        let expected = names(&place.path("old"));
        assert_eq!(names(&place.path(&out)), expected, "moment {moment}");
    }
    assert!(killed >= MOMENTS / 4, "{killed} killed");
}

/// Each signal that a program can handle, as soon as the results are being written.
#[test]
fn an_interrupted_run_leaves_no_unfinished_files() {
    let place = Place::new();
    let unfinished = || place.entries().iter().any(|name| name.starts_with(".mde-"));
    place.write("short.toml", TINY.replace("steps = 60", "steps = 5"));
    let before = place.entries();
    let refine = "refine image.png --prior-depth depth.npy --fov 60 --config short.toml --export ply,glb,exr,colmap,sigma -o out";
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        // A run may be finished before the signal arrives.
        let interrupted = (0..20).any(|_| {
            let mut child = start(&place, refine);
            while !unfinished() && child.try_wait().unwrap().is_none() {
                sleep(Duration::from_millis(1));
            }
            let id = child.id().to_string();
            let _ = Command::new("kill").args(["-s", signal, &id]).stderr(Stdio::null()).status();
            let status = child.wait().unwrap();
            let _ = fs::remove_dir_all(place.path("out"));
            assert_eq!(place.entries(), before, "{signal}, {status}");
            status.code() == Some(130)
        });
        assert!(interrupted, "{signal} never ended a run with exit code 130");
    }
}

#[test]
fn an_evaluation_killed_at_any_moment_resumes_to_the_same_bytes() {
    let place = Place::new();
    place.write(
        "short.toml",
        TINY.replace("steps = 60", "steps = 10").replace("iterations = 2", "iterations = 1"),
    );
    let eval = "eval --dataset rooms --size 64x48 --limit 2 --methods guided,short.toml";
    let course = Course::of(&place, &format!("{eval} -o whole"));
    let expected = entries(&place.path("whole"));
    assert!(expected.len() >= 8);

    let mut killed = 0;
    for moment in 0..MOMENTS {
        let root = place.path(&format!("e{moment}"));
        let again = format!("{eval} -o e{moment}");
        killed += u32::from(kill_at(&place, &again, moment, &course));
        for (name, bytes) in entries(&root) {
            assert!(expected[&name] == bytes, "moment {moment}: {}", name.display());
        }
        for name in ["summary.json", "eval.json"] {
            if let Ok(text) = fs::read_to_string(root.join(name)) {
                serde_json::from_str::<serde_json::Value>(&text).unwrap();
            }
        }
        place.mde(&again).assert().success();
        assert!(entries(&root) == expected, "moment {moment}: other bytes than an unbroken run's");
        assert_eq!(names(&root), names(&place.path("whole")), "moment {moment}");
    }
    assert!(killed >= MOMENTS / 4, "{killed} killed");
}
