//! The state of a refinement between two iterations, on disk.

use crate::output::folder::temporary_folder;
use crate::output::provenance::write_json;
use crate::run::interrupt;
use anyhow::{Context, Result};
use mde_cli::{Checkpoint, IterationReport};
use mde_prior::format::{ReadOptions, read_values, write_npz};
use mde_uncertainty::GaussianDepth;
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

const RECORD: &str = "state.json";
const MAPS: &str = "maps.npz";

/// `OUT.resume`: one folder per iteration, written atomically.
pub(crate) struct Checkpoints {
    folder: PathBuf,
    made_from: Value,
}

#[derive(Serialize, Deserialize)]
struct Record {
    /// Everything that the maps depend on.
    made_from: Value,
    iterations: Vec<IterationReport>,
}

impl Checkpoints {
    /// In a folder beside the output.
    pub(crate) fn new(output: &Path, made_from: Value) -> Self {
        let mut name = output.file_name().unwrap_or_default().to_owned();
        name.push(".resume");
        Self { folder: output.with_file_name(name), made_from }
    }

    /// The latest state with the same inputs and settings. Unreadable states and states of other runs are ignored.
    pub(crate) fn latest(&self, iterations: usize) -> Option<Checkpoint> {
        (1..iterations).rev().find_map(|count| self.read(count).ok().flatten())
    }

    fn read(&self, count: usize) -> Result<Option<Checkpoint>> {
        let folder = self.folder.join(count.to_string());
        let record: Record = serde_json::from_str(&fs::read_to_string(folder.join(RECORD))?)?;
        if record.made_from != self.made_from || record.iterations.len() != count {
            return Ok(None);
        }
        let map = |name: &str| -> Result<Array2<f32>> {
            let options = ReadOptions { npz_array: Some(name.into()), ..ReadOptions::default() };
            Ok(read_values(folder.join(MAPS), &options)?)
        };
        let depth = GaussianDepth::new(map("depth")?, map("variance")?)?;
        Ok(Some(Checkpoint { prior: map("prior")?, depth, iterations: record.iterations }))
    }

    /// Writes the state after an iteration.
    pub(crate) fn keep(&self, state: &Checkpoint) -> Result<()> {
        let fault = || format!("{}: can't write the iteration there", self.folder.display());
        fs::create_dir_all(&self.folder).with_context(fault)?;
        let temporary = temporary_folder(&self.folder)?;
        interrupt::guard(temporary.path());
        let arrays = [
            ("prior", state.prior.view()),
            ("depth", state.depth.mean()),
            ("variance", state.depth.variance()),
        ];
        write_npz(temporary.path().join(MAPS), &arrays)?;
        let record = Record { made_from: self.made_from.clone(), iterations: state.iterations.clone() };
        write_json(&temporary.path().join(RECORD), &record)?;
        let mut guarded = interrupt::temporary();
        let place = self.folder.join(state.iterations.len().to_string());
        if place.exists() {
            fs::rename(&place, temporary.path().join("old")).with_context(fault)?;
        }
        fs::rename(temporary.path(), &place).with_context(fault)?;
        *guarded = None;
        let _ = temporary.keep();
        let _ = fs::remove_dir_all(place.join("old"));
        Ok(())
    }

    /// Removes the folder once the results are written.
    pub(crate) fn discard(&self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}
