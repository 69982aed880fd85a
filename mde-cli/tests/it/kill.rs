//! Whenever a run is killed, its output is the old one or the new one; an evaluation continues to the same bytes.

use crate::common::{Place, REFINE, copy, fixture, names, send, tiny};
use serde_json::Value;
use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

const SIGNALS: [&str; 4] = ["KILL", "TERM", "KILL", "QUIT"];

#[test]
fn a_refinement_killed_at_any_moment_leaves_old_or_new() {
    let place = Place::new();
    place.write("tiny.toml", tiny(20, 4));
    place.run(&format!("{REFINE} --seed 7 -o old"));
    for moment in 0..12 {
        copy(&place.path("old"), &place.path(&format!("out{moment}")));
    }
    let old = place.maps("old");
    place.kill_at_moments(&format!("{REFINE} --force"), 12, &SIGNALS, |out, _| {
        let (left, new) = (place.maps(out), place.maps("whole"));
        assert!(old != new);
        assert!(left == old || left == new, "{out}: neither the old maps nor the new ones");
        assert_eq!(names(&place.path(out)), names(&place.path("old")), "{out}");
    });
}

/// Each signal that a program can handle, as soon as the results are being written.
#[test]
fn an_interrupted_run_leaves_no_unfinished_files() {
    let place = Place::new();
    let unfinished = || place.entries().iter().any(|name| name.starts_with(".mde-"));
    place.write("long.toml", tiny(1000000, 2));
    place.write("tiny.toml", tiny(5, 2));
    place.write("slow.toml", "width = 1024\nheight = 1024\noutput = 'metric'\n");
    place.take(fixture("slow.onnx"), "slow.onnx");
    let before = place.entries();
    for signal in ["INT", "TERM", "HUP", "QUIT"] {
        // A run may be finished before the signal arrives.
        let interrupted = (0..20).any(|_| {
            let (mut child, _lines) =
                place.start(&format!("{REFINE} --export ply,glb,exr,colmap,sigma -o out"));
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
    // Nor, in a long fit or in a network that repeats a convolution for minutes, the folders above its output.
    let fit = REFINE.replace("tiny", "long");
    for (run, stage, signal) in [
        (&*fit, "\"fit\"", "INT"),
        (&fit, "\"fit\"", "TERM"),
        #[cfg(feature = "onnx")]
        ("refine image.png --prior-model slow.onnx --fov 60", "\"prior\"", "INT"),
    ] {
        let (mut child, mut lines) = place.start(&format!("{run} --log-json -o a/b/out"));
        assert!(lines.any(|line| line.contains(stage)), "{run}: no {stage}");
        sleep(Duration::from_millis(200));
        assert!(child.try_wait().unwrap().is_none(), "{run}: not slow");
        let begin = Instant::now();
        send(&child, signal);
        assert_eq!(child.wait().unwrap().code(), Some(130));
        assert!(begin.elapsed() < Duration::from_secs(60), "{run}: {:?}", begin.elapsed());
        assert_eq!(place.entries(), before, "{run}");
        // A prediction cannot be stopped: the program ends without a message.
        assert!(stage == "\"prior\"" || lines.any(|line| line.contains("interrupted")), "{run}");
    }
}

#[test]
fn an_evaluation_killed_at_any_moment_resumes_to_the_same_bytes() {
    let place = Place::new();
    place.write("short.toml", tiny(10, 1));
    let eval = "eval --dataset rooms --size 64x48 --limit 2 --methods guided,short.toml";
    place.kill_at_moments(eval, 12, &SIGNALS, |out, _| {
        let whole = place.maps("whole");
        assert!(whole.len() >= 8);
        // What has its name is whole.
        for (name, bytes) in place.maps(out) {
            assert!(whole[&name] == bytes, "{out}: {name}");
        }
        for method in place.below(out, "scenes/*/*/") {
            assert!(method.join("method.json").is_file(), "{out}");
        }
        for record in place.below(out, "**/*.json") {
            serde_json::from_slice::<Value>(&fs::read(record).unwrap()).unwrap();
        }
        place.run(&format!("{eval} -o {out}"));
        assert!(place.maps(out) == whole, "{out}: other bytes than an unbroken run's");
        assert_eq!(names(&place.path(out)), names(&place.path("whole")), "{out}");
    });
}
