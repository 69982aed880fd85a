//! Runs a table of cases through the built program.

use crate::common::{Place, names};
use crate::inputs::place;
use mde_cli::mde_prior::format::{ReadOptions, read_values};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use std::{fs, thread};

/// The settings of the cases that run through.
pub(crate) const QUICK: &str = "--fov 60 --preset fast --config quick.toml";

/// Arguments after `mde`, the exit code, and what the message must contain.
///
/// `-o OUT --quiet` is added where no `-o` is named and the arguments make something.
#[derive(Clone)]
pub(crate) struct Case {
    pub(crate) arguments: String,
    pub(crate) code: i32,
    pub(crate) told: Vec<&'static str>,
}

/// Exit code 1 and a line that contains `told`.
pub(crate) fn refused(arguments: impl Into<String>, told: &[&'static str]) -> Case {
    Case { arguments: arguments.into(), code: 1, told: told.to_vec() }
}

/// Exit code 2: the usage.
pub(crate) fn misused(arguments: impl Into<String>, told: &[&'static str]) -> Case {
    Case { arguments: arguments.into(), code: 2, told: told.to_vec() }
}

/// Odd, but it works.
pub(crate) fn works(arguments: impl Into<String>) -> Case {
    Case { arguments: arguments.into(), code: 0, told: Vec::new() }
}

thread_local! {
    /// Cases that are refused, where they are counted and not run.
    static COUNTED: Cell<Option<usize>> = const { Cell::new(None) };
}

/// The number of cases of these tests that are refused; none is run.
pub(crate) fn counted(tests: &[fn()]) -> usize {
    COUNTED.set(Some(0));
    tests.iter().for_each(|test| test());
    COUNTED.take().unwrap_or_default()
}

/// Whether these many cases are counted only.
pub(crate) fn count(refused: usize) -> bool {
    COUNTED.get().is_some_and(|sum| {
        COUNTED.set(Some(sum + refused));
        true
    })
}

/// Runs the cases, some at once, and fails with all that went wrong.
pub(crate) fn check(cases: &[Case]) {
    if count(cases.iter().filter(|case| case.code != 0).count()) {
        return;
    }
    let place = place();
    let before = contents(&place.path("."));
    let next = AtomicUsize::new(0);
    let work = || {
        let mut faults = Vec::new();
        while let Some(case) = cases.get(next.fetch_add(1, Ordering::SeqCst)) {
            faults.extend(run(case, &place).err().map(|fault| format!("{}\n    {fault}", case.arguments)));
        }
        faults
    };
    let faults: Vec<String> = thread::scope(|scope| {
        let workers: Vec<_> = (0..2).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    assert!(faults.is_empty(), "{} of {}:\n{}", faults.len(), cases.len(), faults.join("\n"));
    assert!(contents(&place.path(".")) == before, "the inputs are not what they were");
}

fn run(case: &Case, place: &Place) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_mde"));
    command.current_dir(place.path(".")).args(case.arguments.split_whitespace());
    if case.code != 2 && !case.arguments.contains("-o ") && !case.arguments.starts_with("config") {
        command.arg("--quiet").arg("-o").arg(&out);
    }
    let (code, stdout, stderr) = finish(command)?;
    let message = stderr.trim_end();
    expect(code == Some(case.code), || format!("exit code {code:?}: {message}"))?;
    for part in &case.told {
        expect(message.contains(part), || format!("no {part:?} in: {message}"))?;
    }
    match case.code {
        0 => complete(&out),
        // What did not fail is written.
        3 => expect(out.join("summary.json").is_file(), || "wrote no summary".into()),
        1 => {
            expect(message.starts_with("error: "), || message.to_owned())?;
            expect(message.lines().count() == 1, || format!("more than a line: {message}"))?;
            expect(message.len() <= 600, || format!("too long to read: {message}"))?;
            expect(stdout.is_empty(), || format!("on stdout: {stdout}"))?;
            expect(!case.told.is_empty(), || "says nothing that is checked".into())?;
            expect(names(folder.path()).is_empty(), || format!("left {:?}", names(folder.path())))
        }
        _ => expect(names(folder.path()).is_empty(), || format!("left {:?}", names(folder.path()))),
    }
}

/// Ends in time, with its exit code, stdout and stderr.
fn finish(mut command: Command) -> Result<(Option<i32>, String, String), String> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().map_err(|e| e.to_string())?;
    let (sender, receiver) = std::sync::mpsc::channel();
    let id = child.id();
    thread::spawn(move || sender.send(child.wait_with_output()));
    let Ok(output) = receiver.recv_timeout(Duration::from_secs(100)) else {
        let _ = Command::new("kill").args(["-KILL", &id.to_string()]).status();
        return Err("did not end".into());
    };
    let output = output.map_err(|e| e.to_string())?;
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Ok((output.status.code(), text(output.stdout), text(output.stderr)))
}

fn expect(ok: bool, fault: impl FnOnce() -> String) -> Result<(), String> {
    if ok { Ok(()) } else { Err(fault()) }
}

/// A refinement's maps are there, of one size, and hold nothing that is no depth.
fn complete(out: &Path) -> Result<(), String> {
    if !out.join("depth.npy").is_file() {
        return expect(out.join("run.json").is_file() || out.join("summary.json").is_file(), || {
            "wrote no record".into()
        });
    }
    let map = |name: &str| {
        read_values(out.join(name), &ReadOptions::default()).map_err(|error| format!("{name}: {error}"))
    };
    let (depth, sigma) = (map("depth.npy")?, map("sigma.npy")?);
    expect(depth.dim() == sigma.dim(), || "maps of two sizes".into())?;
    for (d, s) in depth.iter().zip(&sigma) {
        let known = d.is_finite() && *d > 0.0 && *s > 0.0 && s.is_finite();
        expect(known || (*d == 0.0 && *s == f32::INFINITY), || format!("depth {d}, sigma {s}"))?;
    }
    expect(depth.iter().any(|d| *d > 0.0), || "no depth at all".into())?;
    expect(!names(out).iter().any(|name| name.starts_with('.')), || format!("left {:?}", names(out)))
}

/// Every file below a folder with its bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.insert(path.clone(), Vec::new());
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}
