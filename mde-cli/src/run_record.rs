//! `run.json`: everything that was measured.

use crate::camera::KnownCamera;
use crate::error_bar::Stated;
use crate::prior::PriorOrigin;
use crate::progress::TrainingCurve;
use crate::truth::Comparison;
use anyhow::{Context, Result};
use mde_cli::{EvidenceReport, IterationReport};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What `mde demo` and `mde refine` record.
#[derive(Debug, Serialize)]
pub(crate) struct RunRecord<'r> {
    #[serde(flatten)]
    pub(crate) about: About<'r>,
    pub(crate) prior: &'r PriorOrigin,
    /// The depth files' unit.
    pub(crate) unit: &'static str,
    /// depth.png = depth times this.
    pub(crate) png_scale: f64,
    /// Pixels without a refined depth.
    pub(crate) missing_pixels: usize,
    /// The prior's stage.
    pub(crate) evidence: &'r EvidenceReport,
    /// How sigma was scaled, and the interval.
    pub(crate) error_bar: &'r Stated,
    pub(crate) iterations: &'r [IterationReport],
    /// The fit of every iteration as it went on.
    pub(crate) training: &'r [TrainingCurve],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) scores: Option<Comparison>,
    pub(crate) prior_seconds: f64,
    pub(crate) score_seconds: f64,
}

/// What every command records.
#[derive(Debug, Serialize)]
pub(crate) struct About<'r> {
    pub(crate) command: &'static str,
    /// What was typed, for a shell.
    pub(crate) command_line: String,
    pub(crate) versions: BTreeMap<&'static str, &'static str>,
    /// The image, field or room.
    pub(crate) input: String,
    pub(crate) camera: &'r KnownCamera,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) preset: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) seed: Option<u64>,
    pub(crate) threads: usize,
    pub(crate) warnings: &'r [String],
    /// From the program's start to this record.
    pub(crate) total_seconds: f64,
    pub(crate) peak_memory_bytes: Option<u64>,
}

impl<'r> About<'r> {
    pub(crate) fn new(command: &'static str, input: String, camera: &'r KnownCamera) -> Self {
        Self {
            command,
            command_line: command_line(),
            versions: versions(),
            input,
            camera,
            preset: None,
            seed: None,
            threads: rayon::current_num_threads(),
            warnings: &[],
            total_seconds: 0.0,
            peak_memory_bytes: peak_memory(),
        }
    }
}

/// Writes a record as JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).with_context(|| path.display().to_string())?;
    Ok(mde_prior::write_atomic(path, (text + "\n").as_bytes())?)
}

/// The command that this program was started with, quoted for a shell where needed.
pub(crate) fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| quoted(&argument.to_string_lossy()));
    std::iter::once("mde".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}

fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./,=:+@%^".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.to_owned()
    } else {
        format!("'{}'", argument.replace('\'', r"'\''"))
    }
}

/// The workspace's crates and their versions.
pub(crate) fn versions() -> BTreeMap<&'static str, &'static str> {
    let known = env!("MDE_VERSIONS").split_whitespace().filter_map(|pair| pair.split_once('='));
    known.chain([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]).collect()
}

/// The most memory that the process ever held; Linux tells.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.split_whitespace().next()?.parse::<u64>().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_line_can_be_given_to_a_shell_again() {
        let arguments = ["refine", "a b.png", "--fov=60", "it's", "", "$HOME", "ü.jpg"];
        assert_eq!(arguments.map(quoted).join(" "), r"refine 'a b.png' --fov=60 'it'\''s' '' '$HOME' ü.jpg");
    }
}
