//! `--same-scale`: before photographs are refined, a factor for each that brings the network's depth of all to one scale.
//!
//! [`OneScale`] has the order of the comparisons. Factors depend neither on the number of threads nor on which photographs are finished.

use crate::program::many::item::{Common, Item};
use crate::program::open::photographs::content;
use crate::program::progress::Progress;
use crate::program::workers::{caught, side_by_side};
use crate::refiner::same_scale::{OneScale, groups_warning};
use crate::refiner::{Observer, Silent};
use crate::scene::SameScale;
use anyhow::Result;
use mde_mvs::poses::Prepared;
use serde_json::json;
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
        let prepared = |at: usize| caught(|| common.prepared(&part[at], &scale)).ok();
        let prepared = side_by_side(workers, part.len(), prepared)?;
        let pairs: Vec<_> = prepared.into_iter().flat_map(|prepared| scale.add(prepared)).collect();
        let ratio = |at: usize| caught(|| Ok(scale.ratio(&pairs[at]))).ok().flatten();
        let found = side_by_side(rayon::current_num_threads(), pairs.len(), ratio)?;
        scale.extend(found.into_iter().flatten());
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
