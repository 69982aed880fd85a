//! The folder of an evaluation: one folder per scene and method, each written atomically.

use crate::program::report::PICTURE;
use crate::program::store::{
    Entry, OpenFolder, check_own, file_name, folders_in, lock, remove_unfinished, replace,
};
use crate::program::write_json;
use crate::scene::thumbnail;
use anyhow::{Context, Result, bail};
use mde_eval::Refined;
use mde_prior::format::{Format, ReadOptions, decode, write_npy};
use mde_prior::photo::write_image;
use ndarray::ArrayView3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// The inputs that all results share. This file marks the folder of an evaluation.
const BASIS: &str = "eval.json";
const RECORD: &str = "method.json";
const DEPTH: &str = "depth.npy";
const SIGMA: &str = "sigma.npy";
const SCORES: &str = "scores.json";
const SCENES: &str = "scenes";

/// An evaluation on disk. No other process opens it until this is dropped, but for shards.
pub(crate) struct Store {
    pub(crate) root: PathBuf,
    /// Whether other shards write into the folder.
    shared: bool,
    _folder: OpenFolder,
}

/// A method's result for one scene, with the record of what it was computed from.
#[derive(Debug)]
pub(crate) struct Kept {
    pub(crate) refined: Refined,
    pub(crate) made_from: Value,
    /// Wall time, seconds.
    pub(crate) seconds: f64,
}

/// The row beside the maps.
#[derive(Serialize, Deserialize)]
struct Row {
    seconds: f64,
    report: Value,
}

impl Store {
    /// Opens the evaluation of `basis` in `root`, or starts it; `force` discards an earlier one. Other shards write into a `shared` one.
    pub(crate) fn open(root: &Path, basis: &Value, force: bool, shared: bool) -> Result<Self> {
        check_own(root, BASIS, Path::exists, |_| false)?;
        let folder = OpenFolder::open(root, shared)?;
        let (path, scenes, shown) = (root.join(BASIS), root.join(SCENES), root.display());
        if path.is_file() && force {
            if scenes.exists() {
                fs::remove_dir_all(&scenes).with_context(|| shown.to_string())?;
            }
        } else if path.is_file() {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            let old: Value = serde_json::from_str(&text)
                .with_context(|| format!("{}: broken; give --force to start over", path.display()))?;
            if let Some(change) = difference(&old, basis) {
                bail!(
                    "{shown}: contains another evaluation ({change}); give another name to -o, or --force to start over"
                );
            }
        }
        if force || !path.is_file() {
            write_json(&path, basis)?;
        }
        if !shared {
            for scene in folders_in(&scenes) {
                remove_unfinished(&scene);
                folders_in(&scene).iter().for_each(|method| remove_unfinished(method));
            }
        }
        Ok(Self { root: root.to_owned(), shared, _folder: folder })
    }

    /// Removes the folder if it has no results, after a run that failed before its first map.
    pub(crate) fn discard_if_empty(&self) {
        if self.shared {
            return;
        }
        let scenes = self.root.join(SCENES);
        folders_in(&scenes).iter().for_each(|scene| drop(fs::remove_dir(scene)));
        let _ = fs::remove_dir(scenes);
        let mut names = fs::read_dir(&self.root).into_iter().flatten().flatten();
        if names.all(|entry| entry.file_name() == BASIS || entry.file_name() == lock::FILE) {
            let _ = fs::remove_file(self.root.join(BASIS));
        }
    }

    fn scene(&self, scene: &str) -> PathBuf {
        self.root.join(SCENES).join(file_name(scene))
    }

    fn folder(&self, scene: &str, method: &str) -> PathBuf {
        self.scene(scene).join(file_name(method))
    }

    /// The stored result of a method, if there is one; an error has the reason why it can't be used, such as another `made_from`.
    pub(crate) fn find(&self, scene: &str, method: &str, made_from: &Value) -> Result<Option<Kept>, String> {
        let folder = self.folder(scene, method);
        if !folder.join(RECORD).is_file() {
            return Ok(None);
        }
        let broken = || format!("{} is not as it was written", folder.display());
        let entry = Entry::<Row>::read(&folder, RECORD).ok_or_else(broken)?;
        difference(&entry.made_from, made_from).map_or(Ok(()), Err)?;
        // Read as plain values, since a sigma of zeros alone is valid.
        let map = |name: &str| decode(Format::Npy, &entry.file(&folder, name)?, &ReadOptions::default()).ok();
        let depth = map(DEPTH).ok_or_else(broken)?;
        let has_sigma = entry.files.contains_key(Path::new(SIGMA));
        let sigma = has_sigma.then(|| map(SIGMA).ok_or_else(broken)).transpose()?;
        let Entry { made_from, row: Row { seconds, report }, .. } = entry;
        Ok(Some(Kept { refined: Refined { depth, sigma, report }, made_from, seconds }))
    }

    /// The stored scores of a method, if they can be read.
    pub(crate) fn scores<T: DeserializeOwned>(&self, scene: &str, method: &str) -> Option<T> {
        let text = fs::read_to_string(self.folder(scene, method).join(SCORES)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// Stores a method's scores beside its maps; they are removed with the maps.
    pub(crate) fn keep_scores(&self, scene: &str, method: &str, scores: &impl Serialize) -> Result<()> {
        write_json(&self.folder(scene, method).join(SCORES), scores)
    }

    /// Stores a reduced image of the scene, `[height, width, 3]`, unless there is one.
    pub(crate) fn keep_picture(&self, scene: &str, image: ArrayView3<'_, f32>) -> Result<()> {
        let path = self.scene(scene).join(PICTURE);
        if path.is_file() {
            return Ok(());
        }
        Ok(write_image(path, thumbnail(image).view())?)
    }

    /// Stores a method's result, in place of an older one.
    pub(crate) fn keep(&self, scene: &str, method: &str, kept: &Kept) -> Result<()> {
        let Refined { depth, sigma, report } = &kept.refined;
        let row = Row { seconds: kept.seconds, report: report.clone() };
        let fill = |folder: &Path| {
            write_npy(folder.join(DEPTH), depth.view())?;
            if let Some(sigma) = sigma {
                write_npy(folder.join(SIGMA), sigma.view())?;
            }
            Entry::write(folder, RECORD, kept.made_from.clone(), row)
        };
        replace(&self.folder(scene, method), fill, || Ok(()))
    }
}

/// The first place where two JSON values differ, as `key.key: old -> new`.
fn difference(old: &Value, new: &Value) -> Option<String> {
    if old == new {
        return None;
    }
    let (Some(before), Some(after)) = (old.as_object(), new.as_object()) else {
        return Some(format!(": {old} -> {new}"));
    };
    before.keys().chain(after.keys()).find_map(|key| {
        let change = difference(&old[key], &new[key])?;
        let dot = if change.starts_with(": ") { "" } else { "." };
        Some(format!("{key}{dot}{change}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use serde_json::json;

    fn entry(made_from: Value) -> Kept {
        let depth = Array2::from_elem((3, 4), 2.0);
        let refined = Refined { sigma: Some(&depth * 0.1), depth, report: json!({ "a": 1.0 }) };
        Kept { refined, made_from, seconds: 1.5 }
    }

    #[test]
    fn a_stored_result_is_found_and_one_of_other_inputs_or_a_broken_one_is_stale() {
        let place = tempfile::tempdir().unwrap();
        let store = Store::open(&place.path().join("e"), &json!({ "size": "native" }), false, false).unwrap();
        let made_from = json!({ "config": { "seed": 1 } });
        assert!(store.find("a/b", "paper", &made_from).unwrap().is_none());
        let exact = Refined { sigma: Some(Array2::zeros((3, 4))), ..entry(Value::Null).refined };
        for (name, refined) in [("paper", entry(Value::Null).refined), ("exact", exact)] {
            let kept = Kept { refined: refined.clone(), ..entry(made_from.clone()) };
            store.keep("a/b", name, &kept).unwrap();
            let found = store.find("a/b", name, &made_from).unwrap().unwrap();
            assert_eq!((found.refined, found.seconds), (refined, 1.5));
        }
        let other = json!({ "config": { "seed": 2 } });
        assert_eq!(store.find("a/b", "paper", &other).unwrap_err(), "config.seed: 1 -> 2");
        fs::write(store.folder("a/b", "paper").join(RECORD), "{").unwrap();
        assert!(store.find("a/b", "paper", &made_from).is_err());
    }

    /// As after a kill at any moment: before the first file is in place, and beside finished results.
    #[test]
    fn unfinished_files_stop_no_run_and_are_removed_and_force_starts_over() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().join("e");
        fs::create_dir(&root).unwrap();
        fs::write(root.join(".mde-AbCdEf"), "{ \"si").unwrap();
        let open = |force: bool| Store::open(&root, &json!({ "size": "native" }), force, false).unwrap();
        let store = open(false);
        assert!(!root.join(".mde-AbCdEf").exists() && root.join(lock::FILE).exists());
        store.keep("a", "paper", &entry(Value::Null)).unwrap();
        let left =
            ["scenes/a/paper/.mde-scores", "scenes/a/.mde-picture", ".mde-table"].map(|name| root.join(name));
        left.iter().for_each(|path| fs::write(path, "x").unwrap());
        fs::create_dir(root.join("scenes/a/.mde-folder")).unwrap();
        drop(store);
        let store = open(false);
        assert!(left.iter().all(|path| !path.exists()) && !root.join("scenes/a/.mde-folder").exists());
        assert!(store.find("a", "paper", &Value::Null).unwrap().is_some());
        drop(store);
        assert!(open(true).find("a", "paper", &Value::Null).unwrap().is_none());
        // Someone else's file is not ours to remove.
        fs::write(place.path().join("x"), "").unwrap();
        assert!(Store::open(place.path(), &json!({}), true, false).is_err());
    }
}
