//! One of many photographs: its marker, its refinement, its row.

use crate::output::every::PhotographRow;
use crate::output::record::versions;
use crate::prior::{Uniform, hash_files};
use crate::program::many::index::TABLE;
use crate::program::many::{finished, mark};
use crate::program::open::{Opener, content, scene};
use crate::program::store::OutputFolder;
use crate::program::{Job, Progress, RefineArgs, caught, message, side_by_side};
use crate::refiner::same_scale::{OneScale, groups_warning};
use crate::refiner::{Observer, Plan, Refiner, Silent};
use crate::scene::{Photograph, SameScale, Scene};
use anyhow::Result;
use mde_mvs::poses::Prepared as Matched;
use mde_prior::photo::decode_image;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Photographs that are prepared for one scale, and then compared, side by side.
const CHUNK: usize = 16;

pub(super) struct Item {
    pub(super) path: PathBuf,
    pub(super) folder: String,
    pub(super) same_scale: Option<SameScale>,
}

/// What all photographs share.
pub(super) struct Common<'c> {
    pub(super) args: &'c RefineArgs,
    pub(super) output: &'c Path,
    pub(super) job: Job<'c>,
    /// Everything but the photograph that the results depend on.
    pub(super) settings: String,
}

/// Everything but the photographs that the results depend on, files by their content.
pub(super) fn settings_of(args: &RefineArgs, refiner: &Refiner<'_>) -> Result<String> {
    let camera = &args.common.camera;
    let intrinsics = hash_files(camera.intrinsics.as_deref())?;
    Ok(json!({
        "versions": versions(), "refiner": refiner.identity()?, "output": format!("{:?}", args.common.results.export),
        "camera": (intrinsics, camera.fx, camera.cx, camera.cy, camera.fov), "same_scale": args.same_scale,
    })
    .to_string())
}

impl Common<'_> {
    /// Refines a photograph, unless its folder is finished. What fails is in the row.
    pub(super) fn one(&self, item: &Item) -> PhotographRow {
        let made = caught(|| self.made(item, &mut Progress::silent()));
        made.unwrap_or_else(|error| PhotographRow::failed(&item.path.display().to_string(), &message(&error)))
    }

    /// How many photographs run side by side: one more than processors, as one is decoded or written, where the memory of the largest fits.
    pub(super) fn workers(&self, items: &[Item]) -> usize {
        let mut sizes: Vec<_> = items.iter().map(|item| scene::size(&item.path)).collect();
        sizes.sort_by_key(|(height, width)| std::cmp::Reverse(height * width));
        sizes.dedup();
        let largest = sizes.into_iter().find_map(|size| self.job.refiner.plan("", size, 1).ok());
        let most = rayon::current_num_threads() + 1;
        let fits = largest.map_or(most, |Plan { bytes, shared, .. }| {
            let limit = self.job.refiner.settings().memory.bytes().saturating_sub(shared);
            usize::try_from(limit / (bytes - shared).max(1)).unwrap_or(most)
        });
        fits.clamp(1, most).min(items.len())
    }

    /// The photograph of that content at its size.
    fn opened(&self, item: &Item, bytes: Vec<u8>, progress: &mut Progress) -> Result<Photograph> {
        let photo = decode_image(&bytes).map_err(|error| match error {
            mde_prior::Error::Input(reason) => anyhow::anyhow!(reason),
            other => other.into(),
        })?;
        drop(bytes);
        let camera = &self.args.common.camera;
        Opener { refiner: self.job.refiner, camera, progress }.photograph(&item.path, photo, false)
    }

    /// Whether the first two photographs have matches that agree on a motion of the camera.
    pub(super) fn overlap(&self, items: &[Item]) -> Result<bool> {
        let [first, second, ..] = items else { return Ok(false) };
        let scale = OneScale::new(2, &self.job.refiner.settings().config);
        let prepared = |item: &Item| {
            let one = self.opened(item, content(&item.path)?, &mut Progress::silent())?;
            scale.prepare(one.image.read()?.view(), &one.camera, &Uniform).map_err(anyhow::Error::from)
        };
        Ok(Matched::log_ratio(&prepared(first)?, &prepared(second)?, 0).is_some())
    }

    /// Everything that the results depend on, the photograph by its content.
    fn made_from(&self, item: &Item, bytes: &[u8]) -> String {
        // Without the group, which changes with other photographs.
        let same_scale = item.same_scale.map(|found| (found.factor, found.log_sigma, found.photographs));
        format!("{} {:08x} {} {same_scale:?}", self.settings, crc32fast::hash(bytes), bytes.len())
    }

    fn made(&self, item: &Item, progress: &mut Progress) -> Result<PhotographRow> {
        let Item { path, folder, same_scale } = item;
        let start = Instant::now();
        let shown = path.display().to_string();
        let place = self.output.join(folder);
        let bytes = content(path)?;
        let made_from = self.made_from(item, &bytes);
        let same_scale_group = same_scale.map(|found| found.group);
        if let Some(row) = finished(&place, &made_from).filter(|_| !self.args.common.run.force) {
            return Ok(PhotographRow { photograph: shown, same_scale_group, ..row });
        }
        // By its header alone; what has no header fails when it is decoded.
        let plan = self.job.refiner.plan(&shown, scene::size(path), 1)?;
        let scene = Scene { same_scale: *same_scale, ..Scene::one(self.opened(item, bytes, progress)?) };
        let mut prepared = self.job.refiner.prepare(&scene, &plan, progress)?;
        let folder = Some(folder.clone());
        let mut row = PhotographRow { folder, same_scale_group, ..PhotographRow::new(&shown) };
        let target = OutputFolder::new(&place, true)?;
        self.job.produce(&mut prepared, 0, &shown, &target, progress, |path, refined, progress| {
            row.measure(refined);
            row.warnings = progress.own_warnings.clone();
            row.seconds = start.elapsed().as_secs_f64();
            mark(path, &made_from, &row)
        })?;
        Ok(row)
    }

    /// The factors of `--same-scale`. They depend neither on the number of threads nor on which photographs are finished.
    pub(super) fn same_scale(&self, items: &[Item], progress: &mut Progress) -> Result<Vec<SameScale>> {
        progress.step(&format!("match {} photographs for one scale", items.len()));
        let (start, workers) = (Instant::now(), self.workers(items));
        let mut scale = OneScale::new(items.len(), &self.job.refiner.settings().config);
        for (chunk, part) in items.chunks(CHUNK).enumerate() {
            let prepared = |item: &Item| {
                let photograph = self.opened(item, content(&item.path)?, &mut Progress::silent())?;
                Ok(self.job.refiner.prepare_scale(&photograph, &scale, &mut Silent)?)
            };
            // What can't be prepared has its reason in its row, when it is refined.
            let prepared = side_by_side(workers, part.len(), |at| caught(|| prepared(&part[at])).ok())?;
            let pairs: Vec<_> =
                prepared.into_iter().flat_map(|prepared| scale.matches.add(prepared)).collect();
            let ratio = |at: usize| caught(|| Ok(scale.matches.ratio(&pairs[at]))).ok().flatten();
            let found = side_by_side(rayon::current_num_threads(), pairs.len(), ratio)?;
            scale.matches.extend(found.into_iter().flatten());
            let done = (chunk * CHUNK + part.len()).min(items.len());
            let left = start.elapsed().as_secs_f64() / done as f64 * (items.len() - done) as f64;
            let text = format!("{} matching pairs", scale.matches.count());
            let value = json!({ "event": "matched", "pairs": scale.matches.count() });
            progress.piece(done, items.len(), &text, (done < items.len()).then_some(left), value);
        }
        let factors = scale.factors()?;
        let warning = groups_warning(&factors, &format!("same_scale_group in {TABLE}"));
        warning.into_iter().for_each(|warning| progress.warn(warning));
        let shared = factors.iter().filter(|factor| !factor.is_alone()).count();
        progress.step(&format!("{shared} of {} photographs share a scale with another", factors.len()));
        Ok(factors)
    }
}
