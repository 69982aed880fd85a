//! A small picture with its depth, written where the program can read it, and settings that take no time.
#![allow(dead_code, clippy::expect_used, clippy::unwrap_used)]

pub(crate) mod capture;

use assert_cmd::Command;
use mde_cli::mde_prior::format::write_npy;
use mde_cli::mde_prior::photo::write_image;
use mde_eval::scene::{Room, Scene, room};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub(crate) const WIDTH: usize = 64;
pub(crate) const HEIGHT: usize = 48;

/// Two short iterations. An estimated variance of the prior would be 0 here and leave the prior, whatever the field.
pub(crate) const TINY: &str = "\
[refinement]
iterations = 2
order = 'paper'
[views]
count = 3
[novel]
count = 2
[nerf.field]
kind = 'hash'
levels = 4
log2-rows = 10
finest = 64
width = 16
[nerf.train]
steps = 60
rays = 128
warm-up = 4
learning-rate = 1e-2
[nerf.sampling]
coarse = 8
fine = 8
[nerf.render]
coarse = 8
fine = 8
[fusion]
prior-variance = 'fixed-relative'
";

/// A folder with `image.png`, `depth.npy` and `tiny.toml`.
pub(crate) struct Place {
    folder: TempDir,
    pub(crate) scene: Scene,
}

impl Place {
    pub(crate) fn new() -> Self {
        let place = Self::empty();
        write_image(place.path("image.png"), place.scene.image.view()).unwrap();
        write_npy(place.path("depth.npy"), place.scene.depth.view()).unwrap();
        fs::write(place.path("tiny.toml"), TINY).unwrap();
        place
    }

    /// Without the files.
    pub(crate) fn empty() -> Self {
        static SCENE: LazyLock<Scene> = LazyLock::new(|| room(Room::Study, 0, WIDTH, HEIGHT).unwrap());
        Self { folder: tempfile::tempdir().unwrap(), scene: SCENE.clone() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    /// Names in the folder, sorted.
    pub(crate) fn entries(&self) -> Vec<String> {
        names(self.folder.path())
    }

    /// The program with this folder as its working directory.
    pub(crate) fn mde(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mde"));
        command.current_dir(self.folder.path()).args(arguments.split_whitespace());
        command
    }
}

/// Waits until a run has come to what `ready` finds. No test fails because the machine is busy: the limit is for runs that hang.
pub(crate) fn wait_until(child: &mut Child, ready: impl Fn() -> bool) {
    let begin = Instant::now();
    while !ready() {
        assert!(child.try_wait().unwrap().is_none(), "the run ended before");
        assert!(begin.elapsed() < Duration::from_secs(600), "the run hangs");
        sleep(Duration::from_millis(1));
    }
}

/// The lines of progress that a whole run prints, by which others are killed at the same point of their work, however busy the
/// machine is.
pub(crate) struct Course {
    lines: usize,
    /// The mean time between two lines.
    between: Duration,
}

impl Course {
    /// Of the command, which is run.
    pub(crate) fn of(place: &Place, arguments: &str) -> Self {
        let begin = Instant::now();
        let run = place.mde(&format!("{arguments} --log-json")).assert().success();
        let lines = run.get_output().stderr.iter().filter(|byte| **byte == b'\n').count();
        assert!(lines > 3, "{lines} lines");
        Self { lines, between: begin.elapsed() / lines as u32 }
    }

    /// Sends the signal after a share of the lines, and of the time between two; whether the run had not ended yet.
    pub(crate) fn kill(&self, place: &Place, arguments: &str, share: f64, signal: &str) -> bool {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
            .current_dir(place.path("."))
            .args(arguments.split_whitespace())
            .arg("--log-json")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let at = share * self.lines as f64;
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        lines.by_ref().take(at as usize).for_each(drop);
        sleep(self.between.mul_f64(at.fract()));
        let id = child.id().to_string();
        let kill = std::process::Command::new("kill").args([signal, &id]).stderr(Stdio::null()).status();
        drop(kill);
        lines.for_each(drop);
        !child.wait().unwrap().success()
    }
}

/// Names in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The folder of real networks and photographs, for tests that are ignored without it.
pub(crate) fn shared() -> PathBuf {
    let folder = std::env::var_os("MDE_SHARED");
    folder.expect("MDE_SHARED names the folder with the networks and photographs").into()
}

/// Copies a folder with what is in it.
pub(crate) fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}
