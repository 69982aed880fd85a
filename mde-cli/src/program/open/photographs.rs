//! The photographs of a command that takes many: files, folders, lists of names.

use anyhow::{Context, Result, bail, ensure};
use glob::{MatchOptions, glob_with};
use mde_prior::{FileKind, open};
use std::collections::HashSet;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};

const PHOTOGRAPHS: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "bmp", "webp"];
/// Those that are not read, and named instead of passed over.
const UNREAD: [&str; 2] = ["heic", "heif"];
const STDIN: &str = "-";
const LIST: &str = "txt";

pub(crate) fn content(path: &Path) -> Result<Vec<u8>> {
    ensure!(path.exists(), "no such photograph; check the path");
    open::read(path, FileKind::Photograph).context("can't be read; give a photograph's file")
}

/// Whether the arguments name more than one photograph: several of them, a folder, a list, a pattern, standard input.
pub(crate) fn are_many(named: &[&Path]) -> bool {
    match named {
        [one] => *one == Path::new(STDIN) || is_list(one) || one.is_dir() || is_pattern(one),
        _ => true,
    }
}

/// All photographs in the order of the arguments, each file once, and missing ones too; those of folders and patterns sorted by name.
pub(crate) fn all(named: &[&Path]) -> Result<Vec<PathBuf>> {
    let (mut paths, mut seen) = (Vec::new(), HashSet::new());
    for name in named {
        for path in named_by(name)? {
            if seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
                paths.push(path);
            }
        }
    }
    Ok(paths)
}

fn named_by(name: &Path) -> Result<Vec<PathBuf>> {
    let (shown, kinds) = (name.display(), PHOTOGRAPHS.join(", "));
    if name == Path::new(STDIN) {
        let text =
            io::read_to_string(io::stdin()).context("-: standard input can't be read as UTF-8 text")?;
        listed("standard input", &text, Path::new("."))
    } else if is_pattern(name) {
        // Not every shell has put the names in its place.
        let found = of_pattern(name);
        ensure!(!found.is_empty(), "{shown}: no photograph ({kinds}) has such a name; check the path");
        Ok(found)
    } else if is_list(name) {
        let fault = || format!("{shown}: the list can't be read; give a text file of paths");
        let text = open::read_text(name, FileKind::Text).with_context(fault)?;
        listed(&shown.to_string(), &text, name.parent().unwrap_or(Path::new(".")))
    } else if name.is_dir() {
        let fault = || format!("{shown}: the folder can't be read; check the path");
        let entries = std::fs::read_dir(name).and_then(Iterator::collect::<io::Result<Vec<_>>>);
        let paths = entries.with_context(fault)?.into_iter().map(|entry| entry.path());
        let mut found: Vec<_> = paths.filter(|path| is_photograph(path)).collect();
        ensure!(
            !found.is_empty(),
            "{shown}: the folder holds no photograph ({kinds}); folders within it are not searched"
        );
        found.sort();
        Ok(found)
    } else {
        Ok(vec![name.to_path_buf()])
    }
}

fn is_list(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(LIST)) && !path.is_dir()
}

/// The photographs whose names match, in their order; a name that begins with a dot only where the pattern's does.
fn of_pattern(pattern: &Path) -> Vec<PathBuf> {
    let options = MatchOptions {
        case_sensitive: !cfg!(windows),
        require_literal_separator: true,
        require_literal_leading_dot: true,
    };
    let found = pattern.to_str().and_then(|text| glob_with(text, options).ok());
    found.into_iter().flatten().flatten().filter(|path| is_photograph(path)).collect()
}

/// One name or pattern per line, from the working folder, else from `folder`; empty lines and those that begin with # are skipped.
fn listed(list: &str, text: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let place = |line: &str| {
        let places = [PathBuf::from(line), folder.join(line)];
        if let Some(there) = places.iter().find(|path| path.exists()) {
            return vec![there.clone()];
        }
        let mut found = places.iter().map(|pattern| of_pattern(pattern));
        found.find(|found| !found.is_empty()).unwrap_or_else(|| vec![line.into()])
    };
    let paths: Vec<PathBuf> = lines.flat_map(place).collect();
    match paths.iter().any(|path| path.is_file()) {
        true => Ok(paths),
        false if paths.is_empty() => bail!("{list}: names no photograph; give one path per line"),
        false => bail!("{list}: none of its {} lines names a file; give one path per line", paths.len()),
    }
}

/// All photographs that `flag` names, which are there.
pub(crate) fn existing(flag: &str, named: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let paths = all(&named.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    if let Some(missing) = paths.iter().find(|path| !path.is_file()) {
        bail!("{flag} {}: no such photograph; give files or a folder", missing.display());
    }
    Ok(paths)
}

fn is_photograph(path: &Path) -> bool {
    let known = |e: &OsStr| PHOTOGRAPHS.iter().chain(&UNREAD).any(|known| e.eq_ignore_ascii_case(known));
    path.extension().is_some_and(known) && path.is_file()
}

/// Whether it has wildcards (`*`, `?`, `[abc]`) and is no path itself.
fn is_pattern(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.contains(['*', '?', '['])) && !path.exists()
}
