//! A small picture with its depth, where the program can read it; runs of the program and their results.

pub(crate) use crate::library::*;

use assert_cmd::Command;
use glob::{MatchOptions, glob_with};
use mde_cli::mde_mvs::capture::{Distortion, Frame, Lens, transforms_json};
use mde_cli::mde_prior::DisparityRule;
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_npy};
use mde_cli::mde_prior::photo::write_image;
use mde_cli::ndarray::{Array2, ArrayView3};
use mde_cli::output::folder::files_in;
use mde_eval::capture::Capture as Rendered;
use mde_eval::scene::{Room, Scene, room};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A refinement of `image.png` by these settings.
pub(crate) const REFINE: &str = "refine image.png --prior-depth depth.npy --fov 60 --config tiny.toml";

/// A folder with `image.png`, `depth.npy` and `tiny.toml`.
pub(crate) struct Place {
    folder: TempDir,
    pub(crate) scene: Scene,
}

impl Place {
    pub(crate) fn new() -> Self {
        static SCENE: LazyLock<Scene> = LazyLock::new(|| room(Room::Study, 0, WIDTH, HEIGHT).unwrap());
        let place = Self { folder: tempfile::tempdir().unwrap(), scene: SCENE.clone() };
        place.photograph("image.png", place.scene.image.view());
        place.save("depth.npy", &place.scene.depth);
        place.write("tiny.toml", tiny(60, 2));
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The folders above it are made.
    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        fs::write(self.path(name), bytes).unwrap();
    }

    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).unwrap()
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.bytes(name)).unwrap()
    }

    pub(crate) fn record(&self, folder: &str) -> Value {
        self.json(&format!("{folder}/run.json"))
    }

    pub(crate) fn save(&self, name: &str, map: &Array2<f32>) {
        self.write(name, "");
        write_npy(self.path(name), map.view()).unwrap();
    }

    pub(crate) fn photograph(&self, name: &str, image: ArrayView3<'_, f32>) {
        self.write(name, "");
        write_image(self.path(name), image).unwrap();
    }

    pub(crate) fn map(&self, name: &str) -> Array2<f32> {
        read_values(self.path(name), &ReadOptions::default()).unwrap()
    }

    /// Copies a file or a graph of the fixtures.
    pub(crate) fn take(&self, from: impl AsRef<Path>, to: &str) {
        self.write(to, fs::read(self.folder.path().join(from)).unwrap());
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.path(name).exists()
    }

    pub(crate) fn entries(&self) -> Vec<String> {
        names(self.folder.path())
    }

    /// The program with this folder as its working directory.
    pub(crate) fn mde(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mde"));
        command.current_dir(self.folder.path()).args(arguments.split_whitespace());
        command
    }

    /// What a run that succeeds prints.
    pub(crate) fn run(&self, arguments: &str) -> String {
        self.prints(arguments, 0, "")
    }

    /// A run with that exit code that prints these words, separated by ` ; `, but not those after `!`.
    pub(crate) fn prints(&self, arguments: &str, code: i32, words: &str) -> String {
        let run = self.mde(arguments).assert().code(code);
        let printed = [&run.get_output().stdout[..], &run.get_output().stderr].concat();
        let printed = String::from_utf8(printed).unwrap();
        for word in words.split(" ; ") {
            let (wanted, word) = word.strip_prefix('!').map_or((true, word), |word| (false, word));
            assert_eq!(printed.contains(word), wanted, "{arguments}: {word:?} in {printed}");
        }
        printed
    }

    /// A run that ends with one line with these words, and makes no `out`.
    pub(crate) fn refused(&self, arguments: &str, words: &str) {
        let printed = self.prints(arguments, 1, words);
        assert!(printed.lines().count() == 1 && !self.has("out"), "{arguments}: {printed}");
    }

    /// As a process of its own, with the lines of its stderr.
    pub(crate) fn start(&self, arguments: &str) -> (Child, impl Iterator<Item = String> + use<>) {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_mde"))
            .current_dir(self.folder.path())
            .args(arguments.split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        (child, lines)
    }

    /// What a pattern names below a folder; unfinished folders do not count.
    pub(crate) fn below(&self, folder: &str, pattern: &str) -> impl Iterator<Item = PathBuf> + use<> {
        let visible = MatchOptions { require_literal_leading_dot: true, ..MatchOptions::new() };
        let pattern = self.path(folder).join(pattern);
        glob_with(pattern.to_str().unwrap(), visible).unwrap().map(Result::unwrap)
    }

    /// The maps and pictures below a folder by their names.
    pub(crate) fn maps(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let root = self.path(folder);
        let files = ["**/*.npy", "**/*.png", "**/*.ply"].map(|kind| self.below(folder, kind));
        let name = |file: &Path| file.strip_prefix(&root).unwrap().display().to_string();
        files.into_iter().flatten().map(|file| (name(&file), fs::read(&file).unwrap())).collect()
    }

    /// Runs a command to `whole`; then to `out0`, `out1` ..., killed at moments that are spread over its lines of progress, but not at
    /// equal steps, and so at the same points of its work, however busy the machine is. `check` gets each folder with the signal.
    pub(crate) fn kill_at_moments(
        &self,
        command: &str,
        moments: u32,
        signals: &[&'static str],
        mut check: impl FnMut(&str, &str),
    ) {
        let begin = Instant::now();
        let all = self.run(&format!("{command} --log-json -o whole")).lines().count();
        assert!(all > 3, "{all} lines");
        let between = begin.elapsed() / all as u32;
        let mut killed = 0;
        for moment in 0..moments {
            let jitter = (f64::from(moment) * 0.618_034).fract();
            let at = (f64::from(moment) + jitter) / f64::from(moments) * all as f64;
            let (out, signal) = (format!("out{moment}"), signals[moment as usize % signals.len()]);
            let (mut child, mut lines) = self.start(&format!("{command} --log-json -o {out}"));
            lines.by_ref().take(at as usize).for_each(drop);
            sleep(between.mul_f64(at.fract()));
            send(&child, signal);
            lines.for_each(drop);
            killed += u32::from(!child.wait().unwrap().success());
            check(&out, signal);
        }
        assert!(killed >= moments / 4, "{killed} killed");
    }
}

/// A graph of `mde-prior`'s tests.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures").join(name)
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

/// Sends a signal; the process may have ended.
pub(crate) fn send(child: &Child, signal: &str) {
    let id = child.id().to_string();
    let _ = std::process::Command::new("kill").args(["-s", signal, &id]).stderr(Stdio::null()).status();
}

/// The data of a report, which loads nothing: the only address in it is the name of the SVG namespace.
pub(crate) fn report_data(html: &str) -> Value {
    assert!(html.contains("default-src 'none'"));
    assert_eq!(html.matches("<script").count(), 2);
    assert_eq!(html.matches("://").count(), html.matches("http://www.w3.org/2000/svg").count());
    assert!(!html.contains("<link") && !html.contains("@import") && !html.contains("{{"));
    let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..end]).unwrap()
}

/// How many photographs a run keeps.
pub(crate) fn finished(printed: &str) -> usize {
    printed.matches(": finished before").count()
}

/// Names in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The folder of real networks and photographs, for tests that are ignored without it.
pub(crate) fn shared() -> PathBuf {
    let folder = std::env::var_os("MDE_SHARED");
    folder.expect("MDE_SHARED names the folder with the networks and photographs").into()
}

/// Copies a folder with the files in it.
pub(crate) fn copy(from: &Path, to: &Path) {
    for name in files_in(from).unwrap() {
        fs::create_dir_all(to.join(&name).parent().unwrap()).unwrap();
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

/// Those photographs on disk: `images/0.png` ..., `transforms.json`, `prior.npy` of the first, `quick.toml`; and `grey.onnx`.
pub(crate) fn on_disk(room: &Rendered) -> Place {
    let place = Place::new();
    let mut frames = Vec::new();
    for (index, known) in room.views.iter().enumerate() {
        let name = format!("images/{index}.png");
        place.photograph(&name, known.view.image.view());
        let lens = Lens { camera: known.view.camera, distortion: Distortion::default() };
        frames.push(Frame { photograph: place.path(&name), lens, pose: known.view.pose });
    }
    place.write("transforms.json", transforms_json(&frames, &place.path(""), |_| Vec::new()));
    let prior = room.views[0].prior.as_ref().unwrap().to_depth(&DisparityRule::default()).unwrap();
    place.save("prior.npy", &prior);
    place.write("quick.toml", "nerf.train = { steps = 40, rays = 128 }\nnerf.field.finest = 64\n");
    place.take(fixture("grey_nchw.onnx"), "grey.onnx");
    place
}
