//! Provenance of a run: command, versions, memory.

use crate::output::record::About;
use crate::program::Progress;
use crate::program::store::RECORD;
use crate::refiner::Settings;
use crate::scene::KnownCamera;
use anyhow::{Context, Result};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).with_context(|| path.display().to_string())?;
    Ok(mde_prior::write_atomic(path, (text + "\n").as_bytes())?)
}

/// The command line, quoted for a shell where needed.
pub(crate) fn command_line() -> String {
    let arguments = std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned());
    let words: Vec<String> = std::iter::once("mde".to_owned()).chain(arguments).collect();
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_default()
}

/// The common part of the record of a command, with the warnings and seconds of the refinement that it is at.
pub(crate) fn about<'r>(
    command: &'static str,
    input: String,
    camera: &'r KnownCamera,
    settings: Option<&Settings>,
    progress: &'r Progress,
) -> About<'r> {
    About {
        command_line: Some(command_line()),
        preset: settings.map(|settings| settings.preset.name()),
        seed: settings.map(|settings| settings.config.seed),
        warnings: &progress.own_warnings,
        total_seconds: progress.begun.elapsed().as_secs_f64(),
        peak_memory_bytes: peak_memory(),
        ..About::new(command, input, camera)
    }
}

/// Writes `run.json` of a command: the common part and `more`.
pub(crate) fn write_record(folder: &Path, about: About<'_>, more: Value) -> Result<()> {
    #[derive(Serialize)]
    struct Record<'r> {
        #[serde(flatten)]
        about: About<'r>,
        #[serde(flatten)]
        more: Value,
    }
    write_json(&folder.join(RECORD), &Record { about, more })
}

/// Peak resident memory of the process, bytes; known on Linux only.
pub(crate) fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.split_whitespace().next()?.parse::<u64>().ok()?)
}
