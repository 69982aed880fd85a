//! One of many photographs: its marker, its refinement, its row.

use crate::error::Error;
use crate::output::every::PhotographRow;
use crate::output::preview::{depth_picture, sigma_picture_within, usual_range};
use crate::output::record::versions;
use crate::program::args::RefineArgs;
use crate::program::error::message;
use crate::program::job::Job;
use crate::program::open::photographs::content;
use crate::program::open::scene;
use crate::program::progress::Progress;
use crate::program::store::entry::Entry;
use crate::program::store::folder::{ENTRY, OutputFolder, list_files};
use crate::program::workers::caught;
use crate::refiner::{Plan, Refined, Refiner};
use crate::scene::{Photograph, SameScale, Scene};
use anyhow::{Result, ensure};
use mde_prior::photo::{decode_image, write_rgb_png};
use mde_prior::resample::shrink;
use mde_prior::{FileKind, open};
use ndarray::{Array3, ArrayView3, Axis, concatenate};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Photograph, depth and sigma, small.
pub(crate) const THUMBNAIL: &str = "thumbnail.png";
/// Height of a thumbnail, pixels.
const HEIGHT: usize = 120;

/// A photograph and the name of its folder.
pub(crate) struct Item {
    pub(crate) path: PathBuf,
    pub(crate) folder: String,
    /// The factor of `--same-scale`.
    pub(crate) same_scale: Option<SameScale>,
}

/// What all photographs share.
pub(crate) struct Common<'c> {
    pub(crate) args: &'c RefineArgs,
    pub(crate) output: &'c Path,
    pub(crate) job: Job<'c>,
    /// Everything but the photograph that the results depend on.
    pub(crate) settings: String,
}

/// Everything but the photographs that the results depend on, files by their content.
pub(crate) fn settings_of(args: &RefineArgs, refiner: &Refiner<'_>) -> Result<String> {
    let camera = &args.camera;
    let content = |path: &PathBuf| -> Result<u32> {
        let bytes = open::read(path, FileKind::Settings).map_err(Error::read(path))?;
        Ok(crc32fast::hash(&bytes))
    };
    let intrinsics = camera.intrinsics.as_ref().map(content).transpose()?;
    Ok(json!({
        "versions": versions(), "refiner": refiner.identity()?, "output": format!("{:?}", args.export.export),
        "camera": (intrinsics, camera.fx, camera.cx, camera.cy, camera.fov), "same_scale": args.several.same_scale,
    })
    .to_string())
}

impl Common<'_> {
    /// Refines a photograph, unless its folder is finished. What fails is in the row.
    pub(crate) fn one(&self, item: &Item) -> PhotographRow {
        let made = caught(|| self.made(item, &mut Progress::silent()));
        made.unwrap_or_else(|error| PhotographRow::failed(&item.path.display().to_string(), &message(&error)))
    }

    /// The plan of a photograph, by its header alone; what has no header fails when it is decoded.
    fn plan(&self, item: &Item) -> Result<Plan> {
        let size = scene::size(&item.path);
        Ok(self.job.refiner.plan(&item.path.display().to_string(), size, 1)?)
    }

    /// How many photographs run side by side, at most one more than processors: while one is decoded or written, the others keep the
    /// processors busy. Each thread keeps the memory of its largest photograph.
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
    pub(super) fn opened(&self, item: &Item, bytes: Vec<u8>, progress: &mut Progress) -> Result<Photograph> {
        let photo = decode_image(&bytes).map_err(|error| match error {
            mde_prior::Error::Input(reason) => anyhow::anyhow!(reason),
            other => other.into(),
        })?;
        drop(bytes);
        scene::photograph(self.job.refiner, &self.args.camera, &item.path, photo, false, progress)
    }

    /// Everything that the results depend on, the photograph by its content.
    fn made_from(&self, item: &Item, bytes: &[u8]) -> String {
        let made_from = format!("{} {:08x} {}", self.settings, crc32fast::hash(bytes), bytes.len());
        match &item.same_scale {
            // Without the group, which changes with other photographs.
            Some(SameScale { factor, log_sigma, photographs, .. }) => {
                format!("{made_from} {factor} {log_sigma} {photographs}")
            }
            None => made_from,
        }
    }

    fn made(&self, item: &Item, progress: &mut Progress) -> Result<PhotographRow> {
        let Item { path, folder, same_scale } = item;
        let shown = path.display().to_string();
        let place = self.output.join(folder);
        // Read the marker first: it is a thousand times cheaper than planning.
        let marker = finished(&place).filter(|_| !self.args.run.force);
        let same_scale_group = same_scale.map(|found| found.group);
        if let Some(marker) = marker
            && marker.made_from == self.made_from(item, &content(path)?)
        {
            return Ok(PhotographRow { photograph: shown, kept: true, same_scale_group, ..marker.row });
        }
        ensure!(path.exists(), "no such photograph; check the path");
        let plan = self.plan(item)?;
        let start = Instant::now();
        let bytes = content(path)?;
        let made_from = self.made_from(item, &bytes);
        let photograph = self.opened(item, bytes, progress)?;
        let scene = Scene { same_scale: *same_scale, ..Scene::one(photograph) };
        let mut prepared = self.job.refiner.prepare(&scene, &plan, progress)?;
        let mut row = PhotographRow {
            photograph: shown.clone(),
            folder: Some(folder.clone()),
            same_scale_group,
            ..PhotographRow::default()
        };
        let target = OutputFolder::new(&place, true)?;
        self.job.produce(&mut prepared, 0, &shown, &target, progress, |path, refined, progress| {
            write_rgb_png(path.join(THUMBNAIL), thumbnail(refined)?.view())?;
            row.measure(refined);
            row.warnings = progress.own_warnings().to_vec();
            row.seconds = start.elapsed().as_secs_f64();
            mark(path, &made_from, &row)
        })?;
        Ok(row)
    }
}

/// The entry of a finished folder whose files have the lengths that they were written with.
pub(crate) fn finished(place: &Path) -> Option<Entry<PhotographRow>> {
    Entry::read(place, ENTRY).filter(|entry| entry.has_lengths(place))
}

/// Marks a folder as finished, after all its other files.
pub(crate) fn mark(folder: &Path, made_from: &str, row: &PhotographRow) -> Result<()> {
    list_files(folder)?;
    Entry::write(folder, ENTRY, made_from.into(), row.clone())
}

/// Photograph, depth and sigma / depth side by side.
fn thumbnail(refined: &Refined<'_>) -> Result<Array3<u8>> {
    let (rows, columns, _) = refined.image.dim();
    let width = (columns * HEIGHT / rows.max(1)).clamp(1, 4 * HEIGHT);
    let small =
        |picture: ArrayView3<'_, u8>| shrink(picture.mapv(|v| f32::from(v) / 255.0).view(), (HEIGHT, width));
    let depth = &refined.refinement.depth;
    let relative = ndarray::Zip::from(depth.mean())
        .and(&depth.sigma())
        .map_collect(|z, s| if *z > 0.0 { s / z } else { f32::INFINITY });
    let range = usual_range(relative.iter());
    let parts = [
        shrink(refined.image, (HEIGHT, width)),
        small(depth_picture(depth.mean()).view()),
        small(sigma_picture_within(relative.view(), range).view()),
    ];
    let strip = concatenate(Axis(1), &parts.each_ref().map(|part| part.view()))?;
    Ok(strip.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8))
}
