//! Shards of an evaluation: part of its scenes, by their names. `mde merge` joins them.
//!
//! A shard stores its scenes as an evaluation does, and at its end the scores in a file of its own. Their numbers are kept as bits: numbers
//! in JSON that are read again may differ in their last one.

use crate::program::evaluation::{results, runner, verdict};
use crate::program::evaluation::results::{Partial, Results};
use crate::program::evaluation::runner::Failure;
use crate::program::evaluation::setup::Setup;
use crate::program::evaluation::store::Store;
use crate::program::args::MergeArgs;
use crate::program::store::folder::temporary_folder;
use crate::output::record::versions;
use crate::program::provenance::write_json;
use crate::program::many::Shard;
use crate::program::many::shard::{Claim, check};
use crate::program::many::every::copy;
use crate::program::progress::Progress;
use anyhow::{Context, Result, bail, ensure};
use mde_eval::table::Entry;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Who writes the files.
const PROGRAM: &str = "mde eval --shard";
/// The key of a number's bits.
const BITS: &str = "f64";

/// The scores of a shard.
#[derive(Debug, Serialize, Deserialize)]
struct Part {
    program: String,
    shard: Shard,
    /// Scenes of all shards.
    all: usize,
    /// Identifies their names.
    set: String,
    /// Identifies the settings.
    settings: String,
    /// What the results of all shards share.
    shared: Value,
    failures: Vec<Failure>,
    warnings: Vec<String>,
    scenes: Vec<Scene>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Scene {
    /// In the order of the data set.
    index: usize,
    name: String,
    /// Its entries, numbers as bits; none where it failed.
    entries: Value,
}

/// What the results of all shards share.
#[derive(Serialize, Deserialize)]
struct Shared {
    title: String,
    alignment: String,
    reference: Option<String>,
    record: Value,
}

impl Part {
    fn claim<'c>(&'c self, folder: &'c Path) -> Claim<'c> {
        let items = self.scenes.iter().map(|scene| (&*scene.name, &*scene.name)).collect();
        let Self { shard, all, set, settings, .. } = self;
        Claim { folder, shard: *shard, all: *all, set, settings, complete: true, items }
    }
}

fn file_name(shard: &Shard) -> String {
    format!("eval-shard-{}-of-{}.json", shard.index, shard.count)
}

fn is_part(name: &str) -> bool {
    name.starts_with("eval-shard-") && name.ends_with(".json")
}

/// Whether a folder has shards of an evaluation.
pub(crate) fn are_in(folder: &Path) -> bool {
    let mut entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.any(|entry| is_part(&entry.file_name().to_string_lossy()))
}

/// Runs a shard.
pub(crate) fn run(setup: &Setup<'_>, shard: Shard, reference: &str, progress: &mut Progress) -> Result<()> {
    let path = setup.folder().join(file_name(&shard));
    if path.exists() {
        // It comes back when all scenes are done.
        fs::remove_file(&path).with_context(|| path.display().to_string())?;
    }
    let (entries, failures) = setup.run(progress)?;
    let mut by_scene: BTreeMap<String, Vec<Entry>> = BTreeMap::new();
    for entry in entries {
        by_scene.entry(entry.scene.clone()).or_default().push(entry);
    }
    let scenes = setup.scenes().into_iter().map(|(index, name)| {
        let entries = by_scene.remove(&name).unwrap_or_default();
        Ok(Scene { index, entries: exact(serde_json::to_value(entries)?), name })
    });
    let scenes = scenes.collect::<Result<Vec<_>>>()?;
    let (all, set) = setup.whole();
    let identity = json!({ "versions": versions(), "settings": setup.identity()? });
    let Results { title, alignment, reference, record, failures, .. } =
        setup.results(reference, Vec::new(), failures);
    let part = Part {
        program: PROGRAM.to_owned(),
        shard,
        all,
        set: set.to_owned(),
        settings: format!("{:08x}", crc32fast::hash(identity.to_string().as_bytes())),
        shared: serde_json::to_value(Shared { title, alignment, reference, record })?,
        failures,
        warnings: progress.warnings().to_vec(),
        scenes,
    };
    write_json(&path, &part)?;
    let folder = setup.folder().display();
    let failed: String = verdict::failures(&part.failures).into_iter().map(|line| line + "\n").collect();
    let text = format!(
        "{failed}{} of {all} scenes\nwrote {folder}; mde merge {folder} joins the shards",
        part.scenes.len()
    );
    let value = json!({ "event": "done", "output": folder.to_string(), "scenes": part.scenes.len(), "failures": part.failures });
    progress.result(&text, value);
    match part.failures.first() {
        None => Ok(()),
        Some(first) => {
            let (failed, folder) = (part.failures.len(), folder.to_string());
            Err(Partial { failed, first: first.to_string(), folder }.into())
        }
    }
}

/// Joins shards: the same tables as without them.
pub(crate) fn merge(args: &MergeArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    let mut parts = Vec::new();
    for folder in &args.folders {
        parts.extend(read(folder)?);
    }
    let claims: Vec<Claim<'_>> = parts.iter().map(|(folder, part)| part.claim(folder)).collect();
    check(&claims, "scenes", "mde eval", "eval-shard-*.json")?;
    drop(claims);
    let output = match (&args.run.output, &args.folders[..]) {
        (Some(output), _) => output,
        (None, [one]) => one,
        (None, _) => bail!("-o: give a folder for the scenes of all {} folders", args.folders.len()),
    };
    let Some((first, part)) = parts.first() else { bail!("no shard") };
    let first = first.clone();
    let shared: Shared =
        serde_json::from_value(part.shared.clone()).with_context(|| first.display().to_string())?;
    let store = Store::open(output, &Store::basis(&first)?, false)?;
    let mut scenes = Vec::new();
    let (mut failures, mut warnings) = (Vec::new(), Vec::new());
    for (folder, part) in parts {
        for scene in part.scenes {
            let entries: Vec<Entry> = serde_json::from_value(inexact(scene.entries))
                .with_context(|| format!("{}: shard {}: {}", folder.display(), part.shard, scene.name))?;
            if !entries.is_empty() {
                bring(&folder, &store, &scene.name)?;
            }
            scenes.push((scene.index, scene.name, entries));
        }
        failures.extend(part.failures);
        warnings.extend(part.warnings);
    }
    scenes.sort_by_key(|(index, ..)| *index);
    runner::sort(&mut failures);
    in_order(warnings, scenes.iter().map(|(_, name, _)| &**name))
        .into_iter()
        .for_each(|warning| progress.warn(warning));
    let results = Results {
        title: shared.title,
        alignment: shared.alignment,
        preface: Vec::new(),
        reference: shared.reference,
        entries: scenes.into_iter().flat_map(|(_, _, entries)| entries).collect(),
        failures,
        record: shared.record,
    };
    results::finish(results, store.root(), &mut progress).map_err(|error| match error.is::<Partial>() {
        true => error,
        false => error.context(format!("{}: its shards can't be joined", first.display())),
    })
}

fn read(folder: &Path) -> Result<Vec<(PathBuf, Part)>> {
    let shown = folder.display();
    let fault = || format!("{shown}: the folder can't be read; check the path");
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(folder).with_context(fault)? {
        names.insert(entry.with_context(fault)?.file_name().to_string_lossy().into_owned());
    }
    names.retain(|name| is_part(name));
    ensure!(!names.is_empty(), "{shown}: holds no shard; give the output of mde eval --shard I/N");
    let part = |name: String| {
        let path = folder.join(name);
        let fault = || format!("{}: is no shard of an evaluation; run it again", path.display());
        let part: Part =
            serde_json::from_str(&fs::read_to_string(&path).with_context(fault)?).with_context(fault)?;
        ensure!(part.program == PROGRAM, fault());
        Ok((folder.to_owned(), part))
    };
    names.into_iter().map(part).collect()
}

/// Copies a scene's maps to the output where they are elsewhere.
fn bring(folder: &Path, store: &Store, scene: &str) -> Result<()> {
    let from = folder.join("scenes").join(super::store::file_name(scene));
    let to = store.scene(scene);
    ensure!(from.is_dir(), "{}: is missing; run its shard again", from.display());
    if mde_mvs::capture::same_file(&from, &to) {
        return Ok(());
    }
    let fault = || format!("{}: can't be copied to {}", from.display(), to.display());
    let temporary = temporary_folder(store.root())?;
    let whole = temporary.path().join("whole");
    copy(&from, &whole).with_context(fault)?;
    if to.exists() {
        fs::rename(&to, temporary.path().join("old")).with_context(fault)?;
    }
    fs::create_dir_all(to.parent().unwrap_or(store.root())).with_context(fault)?;
    fs::rename(&whole, &to).with_context(fault)
}

/// The warnings in the order of the scenes that they begin with; those of none first, and once.
fn in_order<'s>(warnings: Vec<String>, scenes: impl Iterator<Item = &'s str>) -> Vec<String> {
    let places: BTreeMap<&str, usize> = scenes.enumerate().map(|(place, scene)| (scene, place + 1)).collect();
    let place = |warning: &str| {
        let ends = warning.char_indices().filter(|(_, c)| [' ', ':'].contains(c)).map(|(end, _)| end);
        ends.filter_map(|end| places.get(&warning[..end])).next_back().copied().unwrap_or_default()
    };
    let mut placed: Vec<(usize, String)> =
        warnings.into_iter().map(|warning| (place(&warning), warning)).collect();
    placed.sort_by_key(|(place, _)| *place);
    let mut common = BTreeSet::new();
    placed.retain(|(place, warning)| *place > 0 || common.insert(warning.clone()));
    placed.into_iter().map(|(_, warning)| warning).collect()
}

/// The value with its floats as bits.
fn exact(value: Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let bits = number.as_f64().unwrap_or_default().to_bits();
            json!({ BITS: format!("{bits:016x}") })
        }
        Value::Array(values) => values.into_iter().map(exact).collect(),
        Value::Object(map) => map.into_iter().map(|(key, value)| (key, exact(value))).collect(),
        other => other,
    }
}

/// The inverse of [`exact`].
fn inexact(value: Value) -> Value {
    match value {
        Value::Object(map) => match map.get(BITS).and_then(Value::as_str).filter(|_| map.len() == 1) {
            Some(bits) => {
                u64::from_str_radix(bits, 16).map_or(Value::Null, |bits| json!(f64::from_bits(bits)))
            }
            None => map.into_iter().map(|(key, value)| (key, inexact(value))).collect(),
        },
        Value::Array(values) => values.into_iter().map(inexact).collect(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_to_the_last_bit() {
        let numbers: Vec<f64> = (1..1000).map(|n| (f64::from(n)).sqrt() * 10_f64.powi(n % 40 - 20)).collect();
        let value = json!({ "a": numbers, "b": { "c": [1, 2, null, "x", 0.1 + 0.2] } });
        let text = exact(value.clone()).to_string();
        assert_eq!(inexact(serde_json::from_str(&text).unwrap()), value);
    }

    #[test]
    fn warnings_follow_the_order_of_the_scenes() {
        let warnings =
            ["b: x", "common", "a 1 net: y", "b net: z", "a: w", "common"].map(str::to_owned).to_vec();
        let ordered = in_order(warnings, ["b", "a", "a 1"].into_iter());
        assert_eq!(ordered, ["common", "b: x", "b net: z", "a: w", "a 1 net: y"]);
    }
}
