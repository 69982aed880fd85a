//! Tables, figures and the exit code.

use crate::output::record::versions;
use crate::program::evaluation::Store;
use crate::program::report::FIGURES;
use crate::program::{Progress, command_line, line_of, partial, report, write_json};
use anyhow::{Context, Result, bail};
use mde_eval::figure;
use mde_eval::statistics::Bootstrap;
use mde_eval::table::{
    self, Block, Document, Entry, Failure, Summary, calibrate, csv, document, is_control, verdict,
};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const TABLE: &str = "table.md";
/// Most methods in a figure: more lines cannot be distinguished.
const LINES: usize = 6;

/// The scores of all scenes and methods.
pub(crate) struct Results {
    pub(crate) title: String,
    /// Describes the alignment, which every number depends on.
    pub(crate) alignment: String,
    /// Blocks before the other tables.
    pub(crate) preface: Vec<Block>,
    /// The method that the others are compared with.
    pub(crate) reference: Option<String>,
    pub(crate) entries: Vec<Entry>,
    pub(crate) failures: Vec<Failure>,
    /// Inputs and settings, for `summary.json`.
    pub(crate) record: Value,
}

/// Writes tables and figures into the folder of `store` and prints the verdict; an error too where some scene or method failed.
pub(crate) fn finish(results: Results, store: &Store, progress: &mut Progress) -> Result<()> {
    written(results, &store.root, progress).inspect_err(|_| store.discard_if_empty())
}

fn written(results: Results, folder: &Path, progress: &mut Progress) -> Result<()> {
    let Results { title, alignment, preface, reference, mut entries, failures, record } = results;
    let failed = table::failed(&failures);
    let first = failed.first().cloned();
    if entries.is_empty() {
        bail!("no scene could be scored{}", first.map_or_else(String::new, |first| format!("; {first}")));
    }
    calibrate(&mut entries);
    let summary = Summary::new(&entries, reference.as_deref(), &Bootstrap::default())?;
    let verdict = verdict(&summary, TABLE);
    let value = json!({ "verdict": verdict, "title": title, "alignment": alignment, "command_line": command_line(), "made_from": record,
        "versions": versions(), "failures": failures, "warnings": progress.own_warnings, "summary": summary });
    let counted = summary.counted();
    let mut tables = vec![Block::Heading(1, title), Block::Text(format!("{counted}. {alignment}"))];
    let lists = [verdict, failed];
    let brief =
        Document { blocks: lists.into_iter().filter(|list| !list.is_empty()).map(Block::List).collect() };
    tables.extend(brief.blocks.iter().cloned());
    tables.extend(preface);
    tables.extend(document(&summary).blocks);

    let table = folder.join(TABLE);
    mde_prior::write_atomic(&table, Document { blocks: tables }.markdown().as_bytes())?;
    let mut scenes = Vec::new();
    csv(&entries, &mut scenes)?;
    mde_prior::write_atomic(&folder.join("scenes.csv"), &scenes)?;
    figures(&entries, folder)?;
    write_json(&folder.join("summary.json"), &value)?;
    let report = report::write(folder)?;
    let text = format!("{counted}; report: {}; tables: {}", line_of(&report), line_of(&table));
    let value = json!({ "event": "result", "summary": value["summary"] });
    progress.result(&brief, &text, value);
    partial(failures.len(), first, folder)
}

/// Tells what a shard has stored; the tables are those of the evaluation of all scenes. An error too where some scene or method failed.
pub(crate) fn finish_part(
    [scenes, all]: [usize; 2],
    failures: &[Failure],
    root: &Path,
    progress: &mut Progress,
) -> Result<()> {
    let failed = table::failed(failures);
    let lines: String = failed.iter().map(|line| format!("{line}\n")).collect();
    let folder = root.display().to_string();
    let text = format!(
        "{lines}{scenes} of {all} scenes\nwrote {folder}; the same command without --shard writes the tables"
    );
    let value = json!({ "scenes": scenes, "failures": failures });
    progress.done(&Document::default(), &text, root, value);
    partial(failures.len(), failed.into_iter().next(), root)
}

/// Figures of at most [`LINES`] sigmas: those of the methods first, then trivial ones. Without a sigma no earlier figure stays.
fn figures(entries: &[Entry], folder: &Path) -> Result<()> {
    let mut names = figure::methods(entries);
    names.sort_by_key(|name| is_control(name));
    names.truncate(LINES);
    let charts = [figure::error_by_percentile, figure::sparsification, figure::reliability];
    for ((name, _), chart) in FIGURES.iter().zip(charts) {
        let path = folder.join(format!("{name}.svg"));
        if !names.is_empty() {
            chart(entries, &names).write(&path)?;
        } else if path.exists() {
            fs::remove_file(&path).with_context(|| format!("{}: can't remove it", path.display()))?;
        }
    }
    Ok(())
}
