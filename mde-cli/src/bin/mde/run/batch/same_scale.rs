//! `--same-scale`: before photographs are refined, a factor for each that brings the network's depth of all to one scale.
//!
//! One prediction and the features of each photograph, at 640 pixels on the longer side; each is matched with the [`NEXT`] before it, and up to
//! [`KEYS`] photographs, evenly spread over all, with each other. Of no more photographs than these is anything in memory. Factors
//! depend neither on the number of threads nor on which photographs are finished.

use super::item::{Common, Item};
use crate::input::size::{shrink, within};
use crate::run::interrupt;
use crate::run::progress::Progress;
use anyhow::{Result, bail};
use mde_cli::results::SameScale;
use mde_mvs::poses::{FeatureConfig, LogRatio, Photograph, PosesConfig, Prepared, common_scale};
use mde_prior::resample::nearest;
use mde_uncertainty::random::derived_seed;
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Photographs before it that each is matched with.
const NEXT: usize = 3;
/// Photographs at most that are all matched with each other: up to so many need no order.
const KEYS: usize = 16;
/// Longer side at which photographs are matched.
const LONGER_SIDE: u32 = 640;
/// Photographs that are prepared, and then matched, side by side.
const CHUNK: usize = 16;
/// Features of a photograph; a ratio needs fewer than a pose.
const FEATURES: usize = 1500;

/// A photograph that is compared with later ones.
type Kept = (usize, Arc<Prepared>);

/// A factor for each item.
pub(super) fn same_scale(
    common: &Common<'_>,
    items: &[Item],
    progress: &mut Progress,
) -> Result<Vec<SameScale>> {
    progress.step(&format!("match {} photographs for one scale", items.len()));
    let start = Instant::now();
    let settings = PosesConfig {
        features: FeatureConfig { max_features: FEATURES, ..FeatureConfig::default() },
        ..PosesConfig::default()
    };
    let seed = derived_seed(common.config.seed, "same-scale", 0);
    let stride = items.len().div_ceil(KEYS).max(1);
    let (mut keys, mut last): (Vec<Kept>, Vec<Kept>) = (Vec::new(), Vec::new());
    let mut ratios = Vec::new();
    for (chunk, part) in items.chunks(CHUNK).enumerate() {
        let first = chunk * CHUNK;
        // What can't be prepared has its reason in its row, when it is refined.
        let prepared = side_by_side(part.len(), |at| common.prepared(&part[at], &settings).ok())?;
        let mut pairs: Vec<[Kept; 2]> = Vec::new();
        for (at, prepared) in prepared.into_iter().enumerate() {
            let index = first + at;
            let Some(Some(prepared)) = prepared else { continue };
            let new: Kept = (index, Arc::new(prepared));
            let is_key = index.is_multiple_of(stride);
            let before: Vec<&Kept> = if is_key {
                keys.iter().filter(|(i, _)| last.iter().all(|(j, _)| i != j)).collect()
            } else {
                Vec::new()
            };
            pairs.extend(before.into_iter().chain(&last).map(|old| [old.clone(), new.clone()]));
            if is_key {
                keys.push(new.clone());
            }
            last.push(new);
            if last.len() > NEXT {
                last.remove(0);
            }
        }
        let found = side_by_side(pairs.len(), |at| {
            let [(first, a), (second, b)] = &pairs[at];
            let ratio = Prepared::log_ratio(a, b, &settings, seed).ok().flatten();
            ratio.map(|[log, sigma]| LogRatio { first: *first, second: *second, log, sigma })
        })?;
        ratios.extend(found.into_iter().flatten().flatten());
        let done = (first + part.len()).min(items.len());
        let left = start.elapsed().as_secs_f64() / done as f64 * (items.len() - done) as f64;
        let text = format!("{} matching pairs", ratios.len());
        let value = json!({ "event": "matched", "pairs": ratios.len() });
        progress.piece(done, items.len(), &text, (done < items.len()).then_some(left), value);
    }
    let factors: Vec<SameScale> =
        common_scale(items.len(), &ratios)?.into_iter().map(SameScale::from).collect();
    let alone = factors.iter().filter(|factor| factor.is_alone()).count();
    let groups = factors.iter().map(|factor| factor.group + 1).max().unwrap_or(0) - alone;
    if groups > 1 {
        progress.warn(format!(
            "--same-scale: the photographs are {groups} groups without a match between them, each on a scale of its own; same_scale_group \
             in {} has the group of each",
            super::index::TABLE
        ));
    }
    progress.step(&format!(
        "{} of {} photographs share a scale with another",
        factors.len() - alone,
        items.len()
    ));
    Ok(factors)
}

impl Common<'_> {
    /// Features of a photograph and a prediction of the network at them.
    fn prepared(&self, item: &Item, settings: &PosesConfig) -> Result<Prepared> {
        let (_taken, _, bytes) = self.read(item)?;
        let (opened, _, camera) = self.decoded(item, bytes, &mut Progress::silent())?;
        let image = opened.photo.pixels;
        let prior = self.prior.for_camera(&camera);
        let depth = prior.prior.predict(image.view())?.to_depth(&self.config.disparity)?;
        let (height, width, _) = image.dim();
        let size = within((height, width), Some(LONGER_SIDE));
        let (image, depth) = (shrink(&image, size), nearest(depth.view(), size));
        let photograph = Photograph {
            name: &item.folder,
            image: image.view(),
            camera: camera.camera.resized(size.1, size.0)?,
            focal_assumed: camera.focal().is_none(),
            prior: Some(depth.view()),
        };
        Ok(Prepared::new(&photograph, &settings.features)?)
    }
}

/// The results of `work` for `0..count`, on as many threads as there are processors; nothing where it failed by a fault.
///
/// These are not the pool's own threads: one that waits for memory would take up another's work, and wait for itself.
fn side_by_side<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Result<Vec<Option<T>>> {
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
    super::on_threads(rayon::current_num_threads().min(count), &run);
    if interrupt::requested() {
        bail!(mde_cli::Error::Interrupted);
    }
    Ok(made.into_inner().unwrap_or_else(PoisonError::into_inner))
}
