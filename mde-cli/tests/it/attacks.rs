//! Folders that are not ours, inputs without an end, names with control characters, numbers that no camera has.

use crate::cases::check;
use crate::common::{Place, REFINE, fixture};
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

/// In what runs print of the folders that they make; of other names see the cases.
#[test]
fn names_of_folders_reach_the_terminal_without_control_characters() {
    let place = Place::new();
    let raw = |bytes: &[u8]| bytes.iter().any(|byte| byte.is_ascii_control() && *byte != b'\n');
    for out in ["red\x1b[31m", "two\nlines"] {
        let run = |code: i32| place.mde(REFINE).args(["-o", out]).assert().code(code);
        let (made, again) = (run(0), run(1));
        for output in [made.get_output(), again.get_output()] {
            assert!(!raw(&output.stdout) && !raw(&output.stderr), "{output:?}");
        }
        assert_eq!(String::from_utf8_lossy(&again.get_output().stderr).lines().count(), 1, "{again}");
    }
}
