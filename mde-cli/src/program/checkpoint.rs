//! The state of a refinement between two iterations, on disk.

use crate::program::provenance::write_json;
use crate::program::resume::ResumeFolder;
use anyhow::Result;
use crate::refinement::Checkpoint;
use crate::reports::iteration::IterationReport;
use mde_prior::format::{ReadOptions, read_values, write_npz};
use mde_uncertainty::GaussianDepth;
use ndarray::Array2;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::Path;

const RECORD: &str = "state.json";
const MAPS: &str = "maps.npz";

/// `OUT.resume` with one entry per iteration.
pub(crate) struct Checkpoints {
    folder: ResumeFolder,
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
    pub(crate) fn new(output: &Path, made_from: Value) -> Result<Self> {
        Ok(Self { folder: ResumeFolder::beside(output, RECORD)?, made_from })
    }

    /// The latest state with the same inputs and settings. Unreadable states and states of other runs are ignored.
    pub(crate) fn latest(&self, iterations: usize) -> Option<Checkpoint> {
        (1..iterations).rev().find_map(|count| self.read(count).ok().flatten())
    }

    fn read(&self, count: usize) -> Result<Option<Checkpoint>> {
        let folder = self.folder.entry(&count.to_string());
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
        let arrays = [
            ("prior", state.prior.view()),
            ("depth", state.depth.mean()),
            ("variance", state.depth.variance()),
        ];
        let record = Record { made_from: self.made_from.clone(), iterations: state.iterations.clone() };
        self.folder.keep(&state.iterations.len().to_string(), |path| {
            write_npz(path.join(MAPS), &arrays)?;
            write_json(&path.join(RECORD), &record)
        })
    }

    /// Removes the folder once the results are written.
    pub(crate) fn discard(&self) {
        self.folder.discard();
    }
}
