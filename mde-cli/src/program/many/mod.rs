//! Many photographs, each refined into a folder of its own.
//!
//! A folder appears whole, by a rename, with its marker (`finished.json`). A run keeps a folder with a marker of its inputs and settings.

pub(crate) mod every;
mod index;
mod item;

use crate::config::Preset;
use crate::output::every::PhotographRow;
use crate::output::names::folders;
use crate::program::many::item::{Common, Item, settings_of};
use crate::program::open::{photographs, prior, refinement_settings};
use crate::program::store::{ENTRY, Entry, OpenFolder, check_own, folders_in, list_files};
use crate::program::workers::{caught, lock, side_by_side};
use crate::program::{Job, Progress, RefineArgs, interrupt, intervals, line_of, partial};
use crate::refiner::{Observer, Refiner};
use anyhow::{Result, bail, ensure};
use mde_eval::table::Document;
use mde_prior::{FileKind, open};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Checks that a folder is new, or one of an earlier run, which writes `record` and `files` beside the photographs; creates nothing.
fn check_folder(output: &Path, record: &str, files: &[&str]) -> Result<()> {
    let is_finished = |folder: &Path| folder.join(ENTRY).is_file();
    // A killed run leaves finished photographs, and beside them files of all.
    let any = folders_in(output).iter().any(|folder| is_finished(folder));
    let is_own = |path: &Path| is_finished(path) || any && files.iter().any(|file| path.ends_with(file));
    let is_record = |path: &Path| {
        let text = open::read(path, FileKind::Text).unwrap_or_default();
        serde_json::from_slice::<Value>(&text).is_ok_and(|record| record["photographs"].is_array())
    };
    check_own(output, record, is_record, is_own)
}

/// The row of a photograph whose folder an earlier run finished from the same inputs.
fn finished(place: &Path, made_from: &str) -> Option<PhotographRow> {
    let entry = Entry::<PhotographRow>::read(place, ENTRY)?;
    (entry.made_from == made_from).then_some(PhotographRow { kept: true, ..entry.row })
}

/// Marks a folder as finished, after all its other files.
fn mark(folder: &Path, made_from: &str, row: &PhotographRow) -> Result<()> {
    list_files(folder)?;
    Entry::write(folder, ENTRY, made_from.into(), row.clone())
}

/// The results of a run for the user: `tables`, numbers of photographs, `more` lines, the folder and its `page`, which a shard has not.
fn finish(
    rows: &[PhotographRow],
    output: &Path,
    page: Option<&str>,
    tables: &Document,
    more: &str,
    mut value: Value,
    progress: &mut Progress,
) -> Result<()> {
    let failed: Vec<String> = rows.iter().filter_map(PhotographRow::failure).collect();
    let kept = rows.iter().filter(|row| row.kept).count();
    let page = match page {
        Some(page) => format!("open {} in a browser", line_of(&output.join(page))),
        None => "the same command without --shard writes the index".to_owned(),
    };
    let text = format!(
        "{} photographs: {} refined, {kept} finished before, {} failed\n{more}wrote {} in {:.1} s; {page}",
        rows.len(),
        rows.len() - kept - failed.len(),
        failed.len(),
        line_of(output),
        progress.seconds()
    );
    value["photographs"] = json!(rows);
    progress.done(tables, &text, output, value);
    partial(failed.len(), failed.into_iter().next(), output)
}

/// Refines all photographs, each alone, side by side as far as the memory goes. The index is written every few seconds and at the end.
pub(crate) fn run(args: &RefineArgs, progress: &mut Progress) -> Result<()> {
    check_arguments(args)?;
    let Some(output) = &args.common.run.output else {
        bail!("-o: give a folder for the results of several photographs")
    };
    let paths = photographs::all(&args.photographs())?;
    let names = folders(paths.iter().map(|path| &**path), &index::FILES);
    let item = |(path, folder)| Item { path, folder, same_scale: None };
    let mut items: Vec<Item> = paths.into_iter().zip(names).map(item).collect();
    check_folder(output, index::RECORD, &index::FILES)?;
    let prior = prior::open(&args.common.prior, false)?;
    let refiner = Refiner::new(&prior, refinement_settings(&args.common, Preset::Default)?)?;
    let settings = settings_of(args, &refiner)?;
    let export = &args.common.results.export;
    let job = Job { command: "refine", refiner: &refiner, export, truth: None, keep_photographs: false };
    let common = Common { args, output, job, settings };
    let _folder = OpenFolder::open(output, args.shard.is_some())?;
    if args.same_scale {
        // Of all photographs, so that a shard has the same factors.
        let factors = common.same_scale(&items, progress)?;
        items.iter_mut().zip(factors).for_each(|(item, factor)| item.same_scale = Some(factor));
    }
    if let Some(shard) = &args.shard {
        items.retain(|item| shard.has(&item.folder));
    }
    let state = Mutex::new(State {
        progress,
        all: items.len(),
        rows: BTreeMap::new(),
        refined: 0,
        start: Instant::now(),
        index: args.shard.is_none().then_some(output),
        due: Instant::now(),
    });
    let work = |index: usize| {
        let row = common.one(&items[index]);
        lock(&state).add(index, row);
    };
    let done = side_by_side(common.workers(&items), items.len(), work);
    let mut state = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    let saved = state.save();
    done?;
    saved?;
    let rows: Vec<PhotographRow> = state.rows.into_values().collect();
    // Each different warning once.
    let mut counted = BTreeMap::<&str, usize>::new();
    rows.iter().flat_map(|row| &row.warnings).for_each(|warning| *counted.entry(warning).or_default() += 1);
    for (warning, count) in counted {
        progress.warn(format!("{count} of {} photographs: {warning}", rows.len()));
    }
    let page = args.shard.is_none().then_some(index::PAGE);
    let mut more = intervals(&refiner.settings().error_bar);
    if args.shard.is_none() && caught(|| common.overlap(&items)).unwrap_or(false) {
        more += "the first two show one place: mde dense takes the photographs of a still scene together, which is more exact\n";
    }
    finish(&rows, output, page, &Document::default(), &more, json!({}), progress)
}

/// Least time between two indices of a run.
const INDEX_SECONDS: Duration = Duration::from_secs(5);
/// The same, over the time that the last one took: with so many photographs that it takes long.
const INDEX_SHARE: u32 = 50;

struct State<'p> {
    progress: &'p mut Progress,
    all: usize,
    rows: BTreeMap<usize, PhotographRow>,
    /// Photographs that were not finished before.
    refined: usize,
    start: Instant,
    /// The folder of the index, which a shard does not write.
    index: Option<&'p Path>,
    due: Instant,
}

impl State<'_> {
    fn add(&mut self, index: usize, row: PhotographRow) {
        if interrupt::requested() && row.error.is_some() {
            return;
        }
        self.refined += usize::from(!row.kept);
        let outcome = match &row.error {
            Some(error) => format!("failed: {error}"),
            None if row.kept => "finished before".to_owned(),
            None => format!("{:.1} s", row.seconds),
        };
        let text = format!("{}: {outcome}", row.photograph);
        let value = json!({ "event": "photograph", "photograph": row.photograph, "folder": row.folder,
            "status": row.status(), "kept": row.kept, "error": row.error, "photograph_seconds": row.seconds });
        self.rows.insert(index, row);
        let (done, all) = (self.rows.len(), self.all);
        let each = self.start.elapsed().as_secs_f64() / self.refined.max(1) as f64;
        let left = (done < all && self.refined > 0).then(|| each * (all - done) as f64);
        self.progress.piece(done, all, &text, left, value);
        if done < all && self.due <= Instant::now() {
            // What prevents it prevents the last one too, which names it.
            let _ = self.save();
        }
    }

    fn save(&mut self) -> Result<()> {
        let start = Instant::now();
        let rows: Vec<&PhotographRow> = self.rows.values().collect();
        let written = self.index.map_or(Ok(()), |folder| index::write(folder, &rows, self.all));
        self.due = Instant::now() + INDEX_SECONDS.max(INDEX_SHARE * start.elapsed());
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
