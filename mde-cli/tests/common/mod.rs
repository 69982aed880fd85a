//! A small picture with its depth, written where the program can read it, and settings that take no time.
#![allow(dead_code, clippy::expect_used, clippy::unwrap_used)]

use assert_cmd::Command;
use mde_cli::mde_prior::format::write_npy;
use mde_cli::mde_prior::photo::write_image;
use mde_eval::scene::{Room, Scene, room};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

pub(crate) const WIDTH: usize = 64;
pub(crate) const HEIGHT: usize = 48;

/// Two short iterations.
pub(crate) const TINY: &str = "\
[refinement]
iterations = 2
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
steps = 200
rays = 128
warm-up = 4
learning-rate = 1e-2
[nerf.sampling]
coarse = 8
fine = 8
[nerf.render]
coarse = 8
fine = 8
";

/// A folder with `image.png`, `depth.npy` and `tiny.toml`.
pub(crate) struct Place {
    folder: TempDir,
    pub(crate) scene: Scene,
}

impl Place {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let scene = room(Room::Study, 0, WIDTH, HEIGHT).unwrap();
        write_image(folder.path().join("image.png"), scene.image.view()).unwrap();
        write_npy(folder.path().join("depth.npy"), scene.depth.view()).unwrap();
        fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
        Self { folder, scene }
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
