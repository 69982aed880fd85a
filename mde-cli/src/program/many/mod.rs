//! Many photographs, each refined alone into a folder of its own, side by side as far as the memory goes.
//!
//! A folder appears whole, by a rename, with its marker (`finished.json`) in it. A run that finds a marker of the same inputs and settings
//! keeps the folder. The index is written from the markers' rows, every few seconds and at the end.

pub(crate) mod every;
mod index;
pub(crate) mod item;
mod same_scale;

use crate::config::Preset;
use crate::output::every::PhotographRow;
use crate::output::names::folders;
use crate::program::args::RefineArgs;
use crate::program::error::partial;
use crate::program::interrupt;
use crate::program::job::Job;
use crate::program::many::index::Index;
use crate::program::many::item::{Common, Item, settings_of};
use crate::program::open::settings::refinement_settings;
use crate::program::open::{photographs, prior};
use crate::program::progress::Progress;
use crate::program::store::folder::{NewFolder, check_place, remove_unfinished};
use crate::program::store::lock::Lock;
use crate::program::summary::intervals;
use crate::program::terminal::line_of;
use crate::program::workers::{lock, side_by_side};
use crate::refiner::{Observer, Refiner};
use anyhow::{Result, bail, ensure};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Refines all photographs that the arguments name.
pub(crate) fn run(args: &RefineArgs, progress: &mut Progress) -> Result<()> {
    check_arguments(args)?;
    let Some(output) = &args.common.run.output else {
        bail!("-o: give a folder for the results of several photographs")
    };
    let paths = photographs::all(&args.photographs())?;
    let names = folders(paths.iter().map(|path| &**path), &index::RESERVED);
    let item = |(path, folder)| Item { path, folder, same_scale: None };
    let mut items: Vec<Item> = paths.into_iter().zip(names).map(item).collect();
    check_place("-o", output)?;
    index::check_folder(output)?;
    let prior = prior::open(&args.common.prior, false)?;
    let refiner = Refiner::new(&prior, refinement_settings(&args.common, Preset::Default)?)?;
    let settings = settings_of(args, &refiner)?;
    let export = &args.common.results.export;
    let job = Job { command: "refine", refiner: &refiner, export, truth: None, keep_photographs: false };
    let common = Common { args, output, job, settings };

    // Removed again where nothing comes into it.
    let _made = NewFolder::make(output)?;
    let _lock = match args.shard {
        None => {
            let lock = Lock::take(output)?;
            remove_unfinished(output);
            lock
        }
        Some(_) => None,
    };
    let found = Index::new(items.len());
    found.mark(output)?;
    if args.same_scale {
        // Of all photographs, so that a shard has the same factors.
        let factors = same_scale::same_scale(&common, &items, progress)?;
        items.iter_mut().zip(factors).for_each(|(item, factor)| item.same_scale = Some(factor));
    }
    if let Some(shard) = &args.shard {
        items.retain(|item| shard.has(&item.folder));
    }
    let start = Instant::now();
    let state = Mutex::new(State {
        progress,
        rows: BTreeMap::new(),
        refined: 0,
        index: found,
        listed: args.shard.is_none(),
        output,
        due: None,
    });
    let work = |index: usize| {
        let row = common.one(&items[index]);
        lock(&state).add(index, row, items.len(), start);
    };
    let done = side_by_side(common.workers(&items), items.len(), work);
    let mut state = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    let saved = state.save();
    done?;
    saved?;
    let State { index: found, listed, .. } = state;
    warnings(&found.rows, progress);
    finish(
        &found.rows,
        listed,
        output,
        &intervals(&refiner.settings().error_bar),
        start.elapsed().as_secs_f64(),
        progress,
    )
}

/// A few words on a photograph, for a line.
fn outcome(row: &PhotographRow) -> String {
    match &row.error {
        Some(error) => format!("failed: {error}"),
        None if row.kept => "finished before".to_owned(),
        None => format!("{:.1} s", row.seconds),
    }
}

/// Least time between two indices of a run.
const INDEX_SECONDS: Duration = Duration::from_secs(5);
/// The same, over the time that the last one took: with so many photographs that it takes long.
const INDEX_SHARE: u32 = 50;

struct State<'p> {
    progress: &'p mut Progress,
    /// By the index of the photograph.
    rows: BTreeMap<usize, PhotographRow>,
    /// Photographs that were not finished before.
    refined: usize,
    /// What a killed run leaves.
    index: Index,
    /// Whether it is written: by a run on all photographs, not by a shard.
    listed: bool,
    output: &'p Path,
    /// When it is written next; at the first photograph.
    due: Option<Instant>,
}

impl State<'_> {
    fn add(&mut self, index: usize, row: PhotographRow, all: usize, start: Instant) {
        if interrupt::requested() && row.error.is_some() {
            return;
        }
        self.refined += usize::from(!row.kept);
        let text = format!("{}: {}", row.photograph, outcome(&row));
        let value = serde_json::json!({ "event": "photograph", "photograph": row.photograph, "folder": row.folder,
            "status": row.status(), "kept": row.kept, "error": row.error, "photograph_seconds": row.seconds });
        self.rows.insert(index, row);
        let done = self.rows.len();
        let each = start.elapsed().as_secs_f64() / self.refined.max(1) as f64;
        let left = (done < all && self.refined > 0).then(|| each * (all - done) as f64);
        self.progress.piece(done, all, &text, left, value);
        if done < all && self.due.is_none_or(|due| due <= Instant::now()) {
            // What prevents it prevents the last one too, which names it.
            let _ = self.save();
        }
    }

    /// Writes the index of the photographs so far.
    fn save(&mut self) -> Result<()> {
        let start = Instant::now();
        self.index.rows = self.rows.values().cloned().collect();
        let written = if self.listed { self.index.write(self.output) } else { Ok(()) };
        self.due = Some(Instant::now() + INDEX_SECONDS.max(INDEX_SHARE * start.elapsed()));
        written
    }
}

/// What a single photograph alone can have is refused.
fn check_arguments(args: &RefineArgs) -> Result<()> {
    let several = "one photograph at a time";
    ensure!(args.views.is_empty(), "--views: refines {several}; give one, or leave --views out");
    ensure!(
        args.common.prior.prior_depth.is_none(),
        "{}: more than one photograph, and --prior-depth is the map of one; give a file, not a folder or a list, or --prior-model",
        args.photographs().iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(" ")
    );
    ensure!(args.gt.is_none(), "--gt: is the truth of one photograph; score a folder with mde eval");
    ensure!(args.scale_from.is_none(), "--scale-from: has the depths of one photograph; refine it alone");
    Ok(())
}

/// Each different warning once, with the number of photographs that had it.
fn warnings(rows: &[PhotographRow], progress: &mut Progress) {
    let mut counted: BTreeMap<&str, usize> = BTreeMap::new();
    for warning in rows.iter().flat_map(|row| &row.warnings) {
        *counted.entry(warning).or_default() += 1;
    }
    for (warning, count) in counted {
        progress.warn(format!("{count} of {} photographs: {warning}", rows.len()));
    }
}

/// Tells what was made; `more` is a line before that of the folder, or empty.
fn finish(
    rows: &[PhotographRow],
    listed: bool,
    output: &Path,
    more: &str,
    seconds: f64,
    progress: &mut Progress,
) -> Result<()> {
    let failed: Vec<&PhotographRow> = rows.iter().filter(|row| row.error.is_some()).collect();
    let kept = rows.iter().filter(|row| row.kept).count();
    let page = match listed {
        true => format!("open {} in a browser", line_of(&output.join(index::PAGE))),
        false => "the same command without --shard writes the index".to_owned(),
    };
    let text = format!(
        "{} photographs: {} refined, {kept} finished before, {} failed\n{more}wrote {} in {seconds:.1} s; {page}",
        rows.len(),
        rows.len() - kept - failed.len(),
        failed.len(),
        line_of(output)
    );
    let value =
        serde_json::json!({ "event": "done", "output": output.display().to_string(), "photographs": rows });
    progress.result(&text, value);
    partial(failed.len(), failed.first().and_then(|row| row.failure()), output)
}
