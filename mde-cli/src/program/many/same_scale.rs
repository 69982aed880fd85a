//! `--same-scale`: before photographs are refined, a factor for each that brings the network's depth of all to one scale.
//!
//! [`OneScale`] has the order of the comparisons. Factors depend neither on the number of threads nor on which photographs are finished.

use crate::program::interrupt;
use crate::program::many::item::{Common, Item};
use crate::program::open::photographs::content;
use crate::program::progress::Progress;
use crate::refiner::Silent;
use crate::refiner::same_scale::{OneScale, groups_warning};
use crate::scene::SameScale;
use anyhow::{Result, bail};
use mde_mvs::poses::Prepared;
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Photographs that are prepared, and then compared, side by side.
const CHUNK: usize = 16;

/// A factor for each item.
pub(super) fn same_scale(
    common: &Common<'_>,
    items: &[Item],
    progress: &mut Progress,
) -> Result<Vec<SameScale>> {
    progress.step(&format!("match {} photographs for one scale", items.len()));
    let (start, workers) = (Instant::now(), common.workers(items));
    let mut scale = OneScale::new(items.len(), &common.job.refiner.settings().config);
    for (chunk, part) in items.chunks(CHUNK).enumerate() {
        // What can't be prepared has its reason in its row, when it is refined.
        let prepared =
            side_by_side(workers.min(part.len()), part.len(), |at| common.prepared(&part[at], &scale).ok())?;
        let mut pairs = Vec::new();
        for prepared in prepared {
            pairs.extend(scale.add(prepared.flatten()));
        }
        let found = side_by_side(rayon::current_num_threads(), pairs.len(), |at| scale.ratio(&pairs[at]))?;
        scale.extend(found.into_iter().flatten().flatten());
        let done = (chunk * CHUNK + part.len()).min(items.len());
        let left = start.elapsed().as_secs_f64() / done as f64 * (items.len() - done) as f64;
        let text = format!("{} matching pairs", scale.matches());
        let value = json!({ "event": "matched", "pairs": scale.matches() });
        progress.piece(done, items.len(), &text, (done < items.len()).then_some(left), value);
    }
    let factors = scale.factors()?;
    let place = format!("same_scale_group in {}", super::index::TABLE);
    groups_warning(&factors, &place).into_iter().for_each(|warning| progress.warn(warning));
    let shared = factors.iter().filter(|factor| !factor.is_alone()).count();
    progress.step(&format!("{shared} of {} photographs share a scale with another", factors.len()));
    Ok(factors)
}

impl Common<'_> {
    /// Features of a photograph and a prediction of the network at them.
    fn prepared(&self, item: &Item, scale: &OneScale) -> Result<Prepared> {
        let photograph = self.opened(item, content(&item.path)?, &mut Progress::silent())?;
        Ok(self.job.refiner.prepare_scale(&photograph, scale, &mut Silent)?)
    }
}

/// The results of `work` for `0..count`, on so many threads of its own; nothing where it failed by a fault.
fn side_by_side<T: Send>(
    threads: usize,
    count: usize,
    work: impl Fn(usize) -> T + Sync,
) -> Result<Vec<Option<T>>> {
    let next = AtomicUsize::new(0);
    let made = Mutex::new((0..count).map(|_| None).collect::<Vec<Option<T>>>());
    let run = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count || interrupt::requested() {
                break;
            }
            let result = catch_unwind(AssertUnwindSafe(|| work(index))).ok();
            made.lock().unwrap_or_else(PoisonError::into_inner)[index] = result;
        }
    };
    super::on_threads(threads.min(count), &run);
    if interrupt::requested() {
        bail!(crate::error::Error::Interrupted);
    }
    Ok(made.into_inner().unwrap_or_else(PoisonError::into_inner))
}
