//! Folders that are not ours, inputs without an end, names with control characters, numbers that no camera has.

use crate::cases::check;
use crate::common::{Place, REFINE, fixture, names};
use crate::fixtures;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

/// `pipe.*` is never written to, and `endless.*` never ends.
fn place() -> Place {
    let place = fixtures::place();
    for net in ["weights", "toml", "hub"] {
        place.take(fixture("external.onnx"), &format!("{net}/external.onnx"));
        place.take(fixture("external.bin"), &format!("{net}/external.bin"));
        place.write(&format!("{net}/external.toml"), "width = 32\nheight = 32\noutput = 'metric'\n");
    }
    for file in ["weights/external.bin", "toml/external.toml", "hub/external.toml"] {
        fs::remove_file(place.path(file)).unwrap();
    }
    fs::create_dir(place.path("record")).unwrap();
    fs::create_dir(place.path("pipes")).unwrap();
    let pipe = |name: &Path| assert!(Command::new("mkfifo").arg(name).status().unwrap().success());
    for kind in ["png", "npy", "onnx", "toml", "txt", "json", "csv", "safetensors"] {
        pipe(&place.path(&format!("pipe.{kind}")));
        symlink("/dev/zero", place.path(&format!("endless.{kind}"))).unwrap();
    }
    for file in
        ["weights/external.bin", "toml/external.toml", "hub/config.json", "record/run.json", "pipes/a.npy"]
    {
        pipe(&place.path(file));
    }
    place
}

#[test]
fn odd_files_names_and_numbers_are_refused_within_seconds() {
    check(&place(), &[("attacks", include_str!("cases/attacks.txt"))], 20);
}

#[test]
fn force_replaces_nothing_that_is_not_ours() {
    let place = Place::new();
    place.run(&format!("{REFINE} --export field -q -o field"));
    for (index, text) in ["", "hello", "{}", "[]", "{\"program\": \"another\"}"].into_iter().enumerate() {
        for (number, command) in [
            REFINE,
            "warp image.png --prior-depth depth.npy --fov 60",
            "render --field field/field.safetensors --size 32x24 --fov 60",
            "demo --preset fast --size 64x48",
        ]
        .into_iter()
        .enumerate()
        {
            let folder = format!("thesis{index}{number}");
            place.write(&format!("{folder}/run.json"), text);
            place.write(&format!("{folder}/thesis.tex"), "years");
            place.write(&format!("{folder}/src/main.rs"), "months");
            place.refused(&format!("{command} --force -q -o {folder}"), &[&folder, "-o"]);
            assert_eq!(names(&place.path(&folder)), ["run.json", "src", "thesis.tex"], "{command}: {text}");
            assert_eq!(place.text(&format!("{folder}/src/main.rs")), "months");
        }
    }
    // In an output of ours too.
    place.run(&format!("{REFINE} -q -o made"));
    place.write("made/notes/today.txt", "years");
    place.write("made/notes.txt", "years");
    let run = place.mde(&format!("{REFINE} -q --force -o made")).assert();
    assert!(matches!(run.get_output().status.code(), Some(0 | 1)), "{run}");
    assert!(place.has("made/notes.txt") && place.has("made/notes/today.txt"));
}

/// Of names that exist, in what runs print, and of folders that they make.
#[test]
fn names_reach_the_terminal_without_control_characters() {
    let place = Place::new();
    let raw = |bytes: &[u8]| bytes.iter().any(|byte| byte.is_ascii_control() && *byte != b'\n');
    for odd in ["red\x1b[31m", "two\nlines"] {
        let image = format!("{odd}.png");
        place.take("image.png", &image);
        place.take("depth.npy", &format!("{odd}.npy"));
        place.write(&format!("{odd}.toml"), crate::common::TINY);
        let out = format!("out {odd}");
        let run = place
            .mde("refine --fov 60")
            .args([
                &image,
                "--prior-depth",
                &format!("{odd}.npy"),
                "--config",
                &format!("{odd}.toml"),
                "-o",
                &out,
            ])
            .assert()
            .success();
        let output = run.get_output();
        assert!(!raw(&output.stdout) && !raw(&output.stderr), "{run}");
        assert!(!String::from_utf8_lossy(&output.stdout).contains(&out) || !odd.contains('\n'), "{run}");
        let again =
            place.mde("refine --fov 60 --prior-depth depth.npy").args([&image, "-o", &out]).assert().code(1);
        let told = &again.get_output().stderr;
        assert!(!raw(told) && told.iter().filter(|byte| **byte == b'\n').count() == 1, "{again}");
    }
}

/// On a disk of 4 KB, and with 4 open files.
#[test]
fn a_failed_run_leaves_no_empty_folder() {
    let place = Place::new();
    let before = place.entries();
    let eval = "eval --dataset rooms --size 64x48 --limit 1 --methods guided";
    for (limit, command) in [("-f 8", REFINE), ("-n 4", REFINE), ("-f 8", eval)] {
        let mde = env!("CARGO_BIN_EXE_mde");
        let script = format!("trap '' XFSZ; ulimit {limit}; exec {mde} {command} -q -o new/deep/out");
        let run = Command::new("sh").current_dir(place.path(".")).args(["-c", &script]).output().unwrap();
        assert!(matches!(run.status.code(), Some(1 | 3)), "{limit}: {run:?}");
        assert_eq!(place.entries(), before, "{limit}: {command}");
    }
}
