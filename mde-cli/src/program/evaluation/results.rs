//! Tables, figures and the exit code.

use crate::output::record::versions;
use crate::program::error::partial;
use crate::program::evaluation::runner::Failure;
use crate::program::evaluation::scoring::SIGMA_BY;
use crate::program::evaluation::store::Store;
use crate::program::evaluation::verdict;
use crate::program::progress::Progress;
use crate::program::provenance::{command_line, write_json};
use crate::program::report;
use crate::program::report::FIGURES;
use crate::program::terminal::line_of;
use anyhow::{Context, Result, ensure};
use mde_eval::figure;
use mde_eval::statistics::Bootstrap;
use mde_eval::table::{Block, Document, Entry, Summary, calibrate, csv, document};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

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

/// Writes tables and figures into `folder` and prints the verdict.
///
/// # Errors
/// [`Partial`] where a scene or method failed; the results of the others are written.
pub(crate) fn finish(results: Results, store: &Store, progress: &mut Progress) -> Result<()> {
    written(results, store.root(), progress).inspect_err(|_| store.discard_if_empty())
}

fn written(mut results: Results, folder: &Path, progress: &mut Progress) -> Result<()> {
    let first = results.failures.first().map(ToString::to_string);
    ensure!(
        !results.entries.is_empty(),
        "no scene could be scored{}",
        first.as_ref().map_or_else(String::new, |first| format!("; {first}"))
    );
    calibrate(&mut results.entries);
    let summary = Summary::new(&results.entries, results.reference.as_deref(), &Bootstrap::default())?;
    let verdict = verdict::sentences(&summary);
    let tables = results.tables(&summary, &verdict);
    let value = json!({
        "verdict": verdict,
        "title": results.title, "alignment": results.alignment, "command_line": command_line(), "made_from": results.record, "versions": versions(),
        "failures": results.failures, "warnings": progress.own_warnings(), "summary": summary,
    });
    let mut scenes = Vec::new();
    csv(&results.entries, &mut scenes)?;
    mde_prior::write_atomic(&folder.join("scenes.csv"), &scenes)?;
    mde_prior::write_atomic(&folder.join("table.md"), tables.markdown().as_bytes())?;
    results.figures(folder)?;
    write_json(&folder.join("summary.json"), &value)?;
    let report = report::write(folder)?;
    let table = folder.join("table.md");
    let text = format!("{}; report: {}; tables: {}", counted(&summary), line_of(&report), line_of(&table));
    let value = json!({ "event": "result", "summary": value["summary"] });
    progress.tables(&results.brief(&verdict), &text, value);
    partial(results.failures.len(), first, folder)
}

/// Tells what a shard has stored; the tables are those of the evaluation of all scenes.
///
/// # Errors
/// [`Partial`] where a scene or method failed.
pub(crate) fn finish_part(
    [scenes, all]: [usize; 2],
    failures: &[Failure],
    root: &Path,
    progress: &mut Progress,
) -> Result<()> {
    let failed: String = verdict::failures(failures).into_iter().map(|line| line + "\n").collect();
    let folder = root.display().to_string();
    let text = format!(
        "{failed}{scenes} of {all} scenes\nwrote {folder}; the same command without --shard writes the tables"
    );
    let value = json!({ "event": "done", "output": folder, "scenes": scenes, "failures": failures });
    progress.result(&text, value);
    partial(failures.len(), failures.first().map(ToString::to_string), root)
}

impl Results {
    fn tables(&self, summary: &Summary, verdict: &[String]) -> Document {
        let sample = counted(summary);
        let mut blocks =
            vec![Block::Heading(1, self.title.clone()), Block::Text(format!("{sample}. {}", self.alignment))];
        blocks.extend(self.brief(verdict).blocks);
        blocks.extend(self.preface.iter().cloned());
        blocks.extend(document(summary).blocks);
        Document { blocks }
    }

    /// The verdict, and what failed.
    fn brief(&self, verdict: &[String]) -> Document {
        let lists = [verdict.to_vec(), verdict::failures(&self.failures)];
        Document { blocks: lists.into_iter().filter(|list| !list.is_empty()).map(Block::List).collect() }
    }

    /// Figures of at most [`LINES`] sigmas: those of the methods first, then trivial ones. Without a sigma no earlier figure stays.
    fn figures(&self, folder: &Path) -> Result<()> {
        let mut names = figure::methods(&self.entries);
        names.sort_by_key(|name| name.contains(SIGMA_BY));
        names.truncate(LINES);
        let charts = [figure::error_by_percentile, figure::sparsification, figure::reliability];
        for ((name, _), chart) in FIGURES.iter().zip(charts) {
            let path = folder.join(format!("{name}.svg"));
            if !names.is_empty() {
                chart(&self.entries, &names).write(&path)?;
            } else if path.exists() {
                fs::remove_file(&path).with_context(|| format!("{}: can't remove it", path.display()))?;
            }
        }
        Ok(())
    }
}

/// The numbers of scenes and places.
fn counted(summary: &Summary) -> String {
    let counted = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    match summary.places < summary.scenes {
        true => format!("{} of {}", counted(summary.scenes, "scene"), counted(summary.places, "place")),
        false => counted(summary.scenes, "scene"),
    }
}
