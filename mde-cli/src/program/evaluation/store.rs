//! The folder of an evaluation: one folder per scene and method, each written atomically.

use crate::program::provenance::write_json;
use crate::program::report::PICTURE;
use crate::program::store::entry::Entry;
use crate::program::store::folder::{
    NewFolder, check_own, file_name, folders_in, remove_unfinished, replace,
};
use crate::program::store::lock::{self, Lock};
use anyhow::{Context, Result, bail};
use mde_eval::Refined;
use mde_prior::format::{Format, ReadOptions, decode, write_npy};
use mde_prior::photo::write_image;
use mde_prior::resample::shrink;
use ndarray::{Array2, ArrayView3};
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
/// The folder of the scenes' folders.
const SCENES: &str = "scenes";
/// Longest side of the reduced image, pixels.
const PICTURE_SIDE: usize = 320;

/// An evaluation on disk. No other process opens it until this is dropped, but for shards.
#[derive(Debug)]
pub(crate) struct Store {
    root: PathBuf,
    /// Whether other shards write into the folder.
    shared: bool,
    // Dropped in this order: the folder can go once the lock is gone.
    _lock: Option<Lock>,
    _made: NewFolder,
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
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    seconds: f64,
    report: Value,
}

impl Store {
    /// Opens the evaluation of `basis` in `root`, or starts it; `force` discards an earlier one. Beside a `shared` one, other shards write
    /// into the folder.
    pub(crate) fn open(root: &Path, basis: &Value, force: bool, shared: bool) -> Result<Self> {
        check_own(root, |path| path == root.join(BASIS), |_| false, BASIS)?;
        let made = NewFolder::make(root)?;
        let lock = if shared { None } else { Lock::take(root)? };
        let store = Self { root: root.to_owned(), shared, _lock: lock, _made: made };
        store.start(basis, force)?;
        Ok(store)
    }

    fn start(&self, basis: &Value, force: bool) -> Result<()> {
        let root = &self.root;
        let shown = root.display();
        let path = root.join(BASIS);
        if path.is_file() && force {
            let scenes = root.join(SCENES);
            if scenes.exists() {
                fs::remove_dir_all(scenes).with_context(|| shown.to_string())?;
            }
            fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
        if path.is_file() {
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            let old: Value = serde_json::from_str(&text)
                .with_context(|| format!("{}: broken; give --force to start over", path.display()))?;
            if let Some(change) = difference(&old, basis) {
                bail!(
                    "{shown}: contains another evaluation ({change}); give another name to -o, or --force to start over"
                );
            }
        } else {
            write_json(&path, basis)?;
        }
        if !self.shared {
            // What interrupted runs left.
            remove_unfinished(root);
            for scene in folders_in(&root.join(SCENES)) {
                remove_unfinished(&scene);
                folders_in(&scene).iter().for_each(|method| remove_unfinished(method));
            }
        }
        Ok(())
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
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

    pub(crate) fn scene(&self, scene: &str) -> PathBuf {
        self.root.join(SCENES).join(file_name(scene))
    }

    fn folder(&self, scene: &str, method: &str) -> PathBuf {
        self.scene(scene).join(file_name(method))
    }

    /// The stored result of a method, if there is one; an error has the reason why it can't be used, such as another `made_from`.
    pub(crate) fn find(&self, scene: &str, method: &str, made_from: &Value) -> Result<Option<Kept>, String> {
        let folder = self.folder(scene, method);
        let path = folder.join(RECORD);
        if !path.is_file() {
            return Ok(None);
        }
        let entry = Entry::<Row>::read(&folder, RECORD);
        let entry = entry.ok_or_else(|| format!("{} is broken", path.display()))?;
        difference(&entry.made_from, made_from).map_or(Ok(()), Err)?;
        let map = |name: &str| -> Result<Array2<f32>, String> {
            // Read as plain values, since a sigma of zeros alone is valid.
            decode(Format::Npy, &entry.file(&folder, name)?, &ReadOptions::default())
                .map_err(|e| format!("{}: {e}", folder.join(name).display()))
        };
        let depth = map(DEPTH)?;
        let sigma = entry.files.contains_key(Path::new(SIGMA)).then(|| map(SIGMA)).transpose()?;
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
        let (height, width, _) = image.dim();
        let scale = (PICTURE_SIDE as f64 / width.max(height) as f64).min(1.0);
        let side = |pixels: usize| ((pixels as f64 * scale).round() as usize).max(1);
        Ok(write_image(path, shrink(image, (side(height), side(width))).view())?)
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
    match (old, new) {
        (Value::Object(old), Value::Object(new)) => {
            let keys = old.keys().chain(new.keys().filter(|key| !old.contains_key(*key)));
            keys.into_iter().find_map(|key| {
                let [before, after] = [old, new].map(|map| map.get(key).unwrap_or(&Value::Null));
                let change = difference(before, after)?;
                Some(if change.starts_with(": ") {
                    format!("{key}{change}")
                } else {
                    format!("{key}.{change}")
                })
            })
        }
        (old, new) if old == new => None,
        (old, new) => Some(format!(": {old} -> {new}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn entry(made_from: Value) -> Kept {
        let depth = Array2::from_elem((3, 4), 2.0);
        let refined = Refined { sigma: Some(&depth * 0.1), depth, report: json!({ "a": 1.0 }) };
        Kept { refined, made_from, seconds: 1.5 }
    }

    #[test]
    fn a_stored_result_is_found_and_one_of_other_inputs_is_stale() {
        let place = tempfile::tempdir().unwrap();
        let store = Store::open(&place.path().join("e"), &json!({ "size": "native" }), false, false).unwrap();
        let made_from = json!({ "config": { "seed": 1 } });
        assert!(store.find("a/b", "paper", &made_from).unwrap().is_none());
        store.keep("a/b", "paper", &entry(made_from.clone())).unwrap();
        let found = store.find("a/b", "paper", &made_from).unwrap().unwrap();
        assert_eq!(found.refined.depth, entry(Value::Null).refined.depth);
        assert_eq!(found.refined.sigma, entry(Value::Null).refined.sigma);
        assert_eq!((found.seconds, found.refined.report), (1.5, json!({ "a": 1.0 })));
        let exact = Kept {
            refined: Refined { sigma: Some(Array2::zeros((3, 4))), ..entry(Value::Null).refined },
            ..entry(made_from.clone())
        };
        store.keep("a/b", "exact", &exact).unwrap();
        let found = store.find("a/b", "exact", &made_from).unwrap().unwrap();
        assert_eq!(found.refined.sigma, exact.refined.sigma);
        let other = json!({ "config": { "seed": 2 } });
        assert_eq!(store.find("a/b", "paper", &other).unwrap_err(), "config.seed: 1 -> 2");
    }

    #[test]
    fn another_evaluation_is_refused_and_force_starts_over() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().join("e");
        let store = Store::open(&root, &json!({ "size": "native" }), false, false).unwrap();
        store.keep("a", "paper", &entry(Value::Null)).unwrap();
        drop(store);
        let other = json!({ "size": [640, 480] });
        let refused = Store::open(&root, &other, false, false).unwrap_err().to_string();
        assert!(refused.contains("size: \"native\" -> [640,480]"), "{refused}");
        let store = Store::open(&root, &other, true, false).unwrap();
        assert!(store.find("a", "paper", &Value::Null).unwrap().is_none());
        fs::write(place.path().join("x"), "").unwrap();
        assert!(Store::open(place.path(), &other, true, false).is_err());
    }

    /// As after a kill at any moment: before the first file is in place, and beside finished results.
    #[test]
    fn unfinished_files_stop_no_run_and_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path().join("e");
        fs::create_dir(&root).unwrap();
        fs::write(root.join(".mde-AbCdEf"), "{ \"si").unwrap();
        let basis = json!({ "size": "native" });
        let store = Store::open(&root, &basis, false, false).unwrap();
        assert!(!root.join(".mde-AbCdEf").exists());
        store.keep("a", "paper", &entry(Value::Null)).unwrap();
        let left =
            ["scenes/a/paper/.mde-scores", "scenes/a/.mde-picture", ".mde-table"].map(|name| root.join(name));
        left.iter().for_each(|path| fs::write(path, "x").unwrap());
        fs::create_dir(root.join("scenes/a/.mde-folder")).unwrap();
        drop(store);
        let store = Store::open(&root, &basis, false, false).unwrap();
        assert!(left.iter().all(|path| !path.exists()) && !root.join("scenes/a/.mde-folder").exists());
        assert!(store.find("a", "paper", &Value::Null).unwrap().is_some());
        // Someone else's file is not ours to remove.
        fs::write(place.path().join("x"), "").unwrap();
        assert!(Store::open(place.path(), &basis, false, false).is_err());
    }
}
