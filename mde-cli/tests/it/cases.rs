//! Cases as text: what a command line is refused with, in one line and without a file written; and odd inputs that work.
//!
//! `= CODE [@MARK] [[FILE]] COMMAND` begins a table, and each line after it is a case: `INPUT => WORD ; WORD`. The input takes the
//! place of `{}` in the command or comes after it; `{a|b}` stands for two cases. With `[name.ext]` the input is the content of a file
//! that `{}` names; with `[folder/]` it is `FILE: CONTENT` in a copy of that folder, which `{}` names, and `{file}` the file. Escapes
//! are those of Rust. Content that begins with `~` is made from that of the fixture of the same name: see [`edited`].
//! `@leaves`: files may stay; `@prints`: it prints and writes nothing; other marks: what is needed. `~/` is an empty folder of the case.
//! The message has every word but `!WORD`, and the name of a case's file; of a command that works, what it prints has them.

use crate::common::{Place, copy, names};
use crate::fixtures;
use anyhow::{Result, ensure};
use assert_cmd::Command;
use glob::glob;
use mde_cli::mde_prior::format::{ReadOptions, read_values};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

struct Case {
    at: String,
    arguments: Vec<String>,
    code: i32,
    told: Vec<String>,
    leaves: bool,
    prints: bool,
}

/// The cases of a text, whose files are written.
fn parse(name: &str, place: &Place) -> Vec<Case> {
    let text = format!("{}/tests/it/cases/{name}.txt", env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(text).unwrap();
    let (mut cases, mut table) = (Vec::new(), "");
    let lines = text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    for (index, line) in lines {
        if let Some(header) = line.strip_prefix("= ") {
            table = header;
            continue;
        }
        let (code, command) = table.split_once(' ').unwrap_or((table, ""));
        let (marks, command): (Vec<_>, Vec<_>) = command.split(' ').partition(|one| one.starts_with('@'));
        let command = command.join(" ");
        let here = marks.iter().all(|mark| match *mark {
            "@leaves" | "@prints" => true,
            "@onnx" => cfg!(feature = "onnx"),
            "@no-onnx" => !cfg!(feature = "onnx"),
            "@onnxruntime" => cfg!(feature = "onnxruntime"),
            "@linux" => cfg!(target_os = "linux"),
            _ => panic!("{mark}"),
        });
        if !here {
            continue;
        }
        let at = format!("{name}-{}", index + 1);
        let (input, words) = line.split_once(" =>").unwrap_or((line, ""));
        let words = words.trim().split(" ; ").filter(|word| !word.is_empty());
        let mut told: Vec<String> = words.map(str::to_owned).collect();
        let command =
            if let Some((spec, rest)) = command.strip_prefix('[').and_then(|rest| rest.split_once("] ")) {
                let [made, file] = written(place, spec, input, &at);
                if code != "0" && !file.contains('\\') && (made == file || rest.contains("{file}")) {
                    told.push(file.clone());
                }
                rest.replace("{file}", &file).replace("{}", &made)
            } else if command.contains("{}") {
                command.replace("{}", input)
            } else {
                format!("{command} {input}")
            };
        for command in expanded(&command) {
            let arguments = command.split_whitespace().map(|one| String::from_utf8(unescaped(one)).unwrap());
            cases.push(Case {
                at: at.clone(),
                arguments: arguments.collect(),
                code: code.parse().unwrap(),
                told: told.clone(),
                leaves: marks.contains(&"@leaves"),
                prints: marks.contains(&"@prints"),
            });
        }
    }
    cases
}

/// The names for `{}` and `{file}` of what is written.
fn written(place: &Place, spec: &str, input: &str, at: &str) -> [String; 2] {
    let Some(folder) = spec.strip_suffix('/') else {
        let (stem, extension) = spec.split_once('.').unwrap();
        let file = format!("{stem}-{at}.{extension}");
        place.write(&file, edited(place, spec, input).unwrap());
        return [file.clone(), file];
    };
    let (name, content) = input.split_once(": ").unwrap_or((input.trim_end_matches(':'), ""));
    let inside = String::from_utf8(unescaped(name)).unwrap();
    let made = format!("{folder}-{at}");
    if place.has(folder) {
        copy(&place.path(folder), &place.path(&made));
    }
    match edited(place, &format!("{folder}/{inside}"), content) {
        Some(bytes) => place.write(&format!("{made}/{inside}"), bytes),
        None => fs::remove_file(place.path(&made).join(&inside)).unwrap(),
    }
    [made.clone(), format!("{made}/{name}")]
}

/// Each `{a|b}` replaced by `a` and by `b`.
pub(crate) fn expanded(text: &str) -> Vec<String> {
    let group = text.find('{').and_then(|start| Some((start, start + text[start..].find('}')?)));
    let Some((start, end)) = group else { return vec![text.to_owned()] };
    let each = text[start + 1..end].split('|');
    each.flat_map(|one| expanded(&format!("{}{one}{}", &text[..start], &text[end + 1..]))).collect()
}

fn unescaped(text: &str) -> Vec<u8> {
    let (mut bytes, mut rest) = (Vec::new(), text);
    while let Some((before, after)) = rest.split_once('\\') {
        bytes.extend(before.as_bytes());
        let (byte, used) = match after.as_bytes()[0] {
            b'n' => (b'\n', 1),
            b'r' => (b'\r', 1),
            b't' => (b'\t', 1),
            b'0' => (0, 1),
            b'x' => (u8::from_str_radix(&after[1..3], 16).unwrap(), 3),
            other => (other, 1),
        };
        bytes.push(byte);
        rest = &after[used..];
    }
    bytes.extend(rest.as_bytes());
    bytes
}

/// The content of a case's file; nothing: there is none.
///
/// `~A ~B` changes that of the fixture `path`: `of FILE` takes another; `cut N`, `cut -N`, `cut N%` keep the first bytes; `put AT VALUE`
/// overwrites, and `add VALUE ...` appends, escaped text or `u32:3`, `u64:3`, `f64:nan`, of which `9*VALUE` are nine; `sub A -> B` in a
/// text; `json POINTER VALUE` and `field POINTER VALUE` in JSON and in the record of a saved field; `npy HEADER` of a map; `png AT VALUE`
/// in a PNG's header; `none`.
pub(crate) fn edited(place: &Place, path: &str, text: &str) -> Option<Vec<u8>> {
    let Some(edits) = text.strip_prefix('~') else { return Some(unescaped(text)) };
    let mut bytes = fs::read(place.path(path)).unwrap_or_default();
    for edit in edits.split(" ~") {
        let (what, rest) = edit.split_once(' ').unwrap_or((edit, ""));
        let at = |text: &str| match (text.strip_prefix('-'), text.strip_suffix('%')) {
            (Some(back), _) => bytes.len() - back.parse::<usize>().unwrap(),
            (_, Some(share)) => bytes.len() * share.parse::<usize>().unwrap() / 100,
            _ => text.parse().unwrap(),
        };
        match what {
            "none" => return None,
            "of" => bytes = place.bytes(rest),
            "cut" => {
                let length = at(rest);
                bytes.truncate(length);
            }
            "put" | "png" => {
                let (start, value) = rest.split_once(' ').unwrap();
                let (start, value) = (at(start), typed(value));
                bytes[start..start + value.len()].copy_from_slice(&value);
                if what == "png" {
                    let checksum = crc32fast::hash(&bytes[12..29]).to_be_bytes();
                    bytes[29..33].copy_from_slice(&checksum);
                }
            }
            "add" => bytes.extend(rest.split(' ').flat_map(typed)),
            "sub" => bytes = replaced(&bytes, rest),
            "json" => bytes = pointed(std::str::from_utf8(&bytes).unwrap(), rest).into_bytes(),
            "npy" => {
                let length = (rest.len() as u16 + 1).to_le_bytes();
                bytes = [b"\x93NUMPY\x01\x00", &length[..], rest.as_bytes(), b"\n"].concat();
            }
            "field" => {
                let length = u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
                let (header, tensors) = bytes[8..].split_at(length);
                let header = with_field(std::str::from_utf8(header).unwrap(), rest, tensors);
                bytes = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), tensors].concat();
            }
            _ => panic!("~{what}"),
        }
    }
    Some(bytes)
}

fn typed(text: &str) -> Vec<u8> {
    let count = text.split_once('*').and_then(|(count, value)| Some((count.parse().ok()?, value)));
    if let Some((count, value)) = count {
        return typed(value).repeat(count);
    }
    match text.split_once(':') {
        Some(("u16", value)) => value.parse::<u16>().unwrap().to_le_bytes().to_vec(),
        Some(("u32", value)) => value.parse::<u32>().unwrap().to_le_bytes().to_vec(),
        Some(("be32", value)) => value.parse::<u32>().unwrap().to_be_bytes().to_vec(),
        Some(("u64", value)) => value.parse::<u64>().unwrap().to_le_bytes().to_vec(),
        Some(("f32", value)) => value.parse::<f32>().unwrap().to_le_bytes().to_vec(),
        Some(("bef32", value)) => value.parse::<f32>().unwrap().to_be_bytes().to_vec(),
        Some(("f64", value)) => value.parse::<f64>().unwrap().to_le_bytes().to_vec(),
        _ => unescaped(text),
    }
}

/// The first of a text replaced by another.
fn replaced(bytes: &[u8], change: &str) -> Vec<u8> {
    let (from, to) = change.split_once(" ->").unwrap();
    let at = bytes.windows(from.len()).position(|part| part == from.as_bytes());
    let (before, rest) = bytes.split_at(at.unwrap_or_else(|| panic!("{from} is not there")));
    [before, to.strip_prefix(' ').unwrap_or(to).as_bytes(), &rest[from.len()..]].concat()
}

/// JSON with the value at a pointer replaced by a text, or removed.
fn pointed(text: &str, change: &str) -> String {
    const MARK: &str = "the changed value";
    let (pointer, to) = change.split_once(' ').unwrap_or((change, ""));
    let mut value: Value = serde_json::from_str(text).unwrap();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match value.pointer_mut(parent).unwrap() {
        Value::Object(fields) if to.is_empty() => drop(fields.remove(key).unwrap()),
        Value::Object(fields) => drop(fields.insert(key.to_owned(), json!(MARK))),
        Value::Array(entries) if to.is_empty() => drop(entries.remove(key.parse().unwrap())),
        Value::Array(entries) => entries[key.parse::<usize>().unwrap()] = json!(MARK),
        _ => panic!("{pointer}"),
    }
    value.to_string().replace(&format!("\"{MARK}\""), to)
}

/// The header of a saved field with a value of its record, and the checksum of that with the `tensors`.
fn with_field(header: &str, change: &str, tensors: &[u8]) -> String {
    let mut outer: Value = serde_json::from_str(header).unwrap();
    let record = &mut outer["__metadata__"]["mde-nerf"];
    let text = pointed(record.as_str().unwrap().split_once(' ').unwrap().1, change);
    *record = json!(format!("{:08x} {text}", crc32fast::hash(&[text.as_bytes(), tensors].concat())));
    outer.to_string()
}

/// Runs the cases side by side and fails with all that went wrong; the number of those that are refused.
fn check(place: &Place, texts: &str, seconds: u64) -> usize {
    let wanted = std::env::var("MDE_CASES").unwrap_or_default();
    let all = texts.split(' ').flat_map(|name| parse(name, place));
    let cases: Vec<Case> = all.filter(|case| case.at.contains(&wanted)).collect();
    let before = contents(&place.path("."));
    let fault_of = |case: &Case| {
        let fault = run(case, place, seconds).err()?;
        Some(format!("{}: {:?}\n    {fault:#}", case.at, case.arguments.join(" ")))
    };
    let faults: Vec<String> = cases.par_iter().with_max_len(1).filter_map(fault_of).collect();
    assert!(faults.is_empty(), "{} of {}:\n{}", faults.len(), cases.len(), faults.join("\n"));
    assert!(contents(&place.path(".")) == before, "the inputs are not what they were");
    if wanted.is_empty() { cases.iter().filter(|case| case.code != 0).count() } else { usize::MAX }
}

fn run(case: &Case, place: &Place, seconds: u64) -> Result<()> {
    const MDE: &str = env!("CARGO_BIN_EXE_mde");
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out");
    let mut command = Command::new(if cfg!(unix) { "sh" } else { MDE });
    if cfg!(unix) {
        // An input without an end takes no more than this.
        command.args(["-c", "ulimit -v 16777216; exec \"$0\" \"$@\"", MDE]);
    }
    let here = format!("{}/", folder.path().display());
    command.current_dir(place.path(".")).args(case.arguments.iter().map(|one| one.replace("~/", &here)));
    if case.code != 2 && !case.prints && !case.arguments.iter().any(|one| one == "-o") {
        command.arg("-o").arg(&out);
        // Warnings are among the words.
        if !matches!(case.code, 0 | 3) || case.told.is_empty() {
            command.arg("--quiet");
        }
    }
    let output = command.timeout(Duration::from_secs(seconds)).output()?;
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    let code = output.status.code();
    let message = stderr.trim_end();
    ensure!(code == Some(case.code), "exit code {code:?}: {message}");
    let works = matches!(case.code, 0 | 3);
    let printed = if case.prints || works { [&*stdout, message].concat() } else { message.to_owned() };
    for part in &case.told {
        let (wanted, part) = part.strip_prefix('!').map_or((true, part.as_str()), |part| (false, part));
        ensure!(printed.contains(part) == wanted, "{part:?} is not as it should be in: {printed}");
    }
    let raw = |text: &str| text.chars().any(|c| c.is_control() && c != '\n');
    ensure!(!raw(&stdout) && !raw(&stderr), "raw control characters: {stdout:?} {stderr:?}");
    match case.code {
        // What did not fail is written.
        0 | 3 if !case.prints => return complete(&out),
        1 => {
            ensure!(message.starts_with("error: "), "{message}");
            ensure!(message.lines().count() == 1, "more than a line: {message}");
            ensure!(message.len() <= 700, "too long to read: {message}");
            ensure!(stdout.is_empty() || case.prints, "on stdout: {stdout}");
            ensure!(!case.told.is_empty(), "nothing of its message is checked");
        }
        _ => {}
    }
    let left = names(folder.path());
    ensure!(case.leaves || left.is_empty(), "left {left:?}");
    Ok(())
}

/// A refinement's maps are there, of one size, and hold nothing that is no depth.
fn complete(out: &Path) -> Result<()> {
    if !out.join("depth.npy").is_file() {
        let mut records = ["run.json", "summary.json", "index.json"].into_iter();
        ensure!(records.any(|name| out.join(name).is_file()), "wrote no record");
        return Ok(());
    }
    let map = |name: &str| read_values(out.join(name), &ReadOptions::default());
    let (depth, sigma) = (map("depth.npy")?, map("sigma.npy")?);
    ensure!(depth.dim() == sigma.dim(), "maps of two sizes");
    for (d, s) in depth.iter().zip(&sigma) {
        let known = d.is_finite() && *d > 0.0 && *s > 0.0 && s.is_finite();
        ensure!(known || (*d == 0.0 && *s == f32::INFINITY), "depth {d}, sigma {s}");
    }
    ensure!(depth.iter().any(|d| *d > 0.0), "no depth at all");
    let names = names(out);
    ensure!(!names.iter().any(|name| name.starts_with('.')), "left {names:?}");
    Ok(())
}

/// Everything below a folder with its length and the time of its last change.
fn contents(folder: &Path) -> Vec<(PathBuf, u64, SystemTime)> {
    let all = glob(&format!("{}/**/*", folder.display())).unwrap().map(Result::unwrap);
    let known = all.map(|path| {
        let metadata = fs::symlink_metadata(&path).unwrap();
        (path, if metadata.is_dir() { 0 } else { metadata.len() }, metadata.modified().unwrap())
    });
    known.collect()
}

/// As many as docs/reliability.md states. `MDE_CASES=maps-12` runs those whose place contains that.
#[test]
fn more_than_seven_hundred_inputs_are_refused_and_odd_ones_work() {
    let place = fixtures::place();
    let texts = "usage photographs maps cameras captures settings records networks evaluations places memory";
    let refused = check(&place, texts, 100);
    assert!(refused > 700, "{refused}");
    // Folders that are not ours, inputs without an end, names with control characters, numbers that no camera has.
    if cfg!(unix) {
        check(&place, "attacks", 20);
    }
}
