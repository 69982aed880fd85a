//! One of many photographs: its marker, its refinement, its row.

use crate::program::many::allowance::{Allowance, Taken};
use crate::program::many::index::Row;
use crate::program::args::RefineArgs;
use crate::program::open::opened::Opening;
use crate::program::open::prior::NamedPrior;
use crate::program::open::size::{limit, sizes};
use crate::program::store::contents::{Contents, have_lengths, lengths};
use crate::program::store::folder::OutputFolder;
use crate::output::record::versions;
use crate::program::provenance::write_json;
use crate::program::job::Job;
use crate::program::progress::Progress;
use anyhow::{Context, Result, ensure};
use crate::scene::size::resized;
use crate::prior::bound::BoundPrior;
use crate::scene::photograph::Opened;
use crate::refiner::plan::inference::PhotographMemory;
use crate::output::every::relative_sigma;
use crate::output::preview::{depth_picture, sigma_picture_within, usual_range};
use crate::refiner::error_bar::ErrorBar;
use crate::refiner::finish::SameScale;
use crate::refiner::run::Done;
use crate::config::{Config, Preset};
use mde_prior::photo::{decode_image, image_size, write_rgb_png};
use mde_uncertainty::statistics::{median, quantile};
use ndarray::{Array3, ArrayView3, Axis, concatenate};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The file of a finished folder, written last.
pub(crate) const MARKER: &str = "finished.json";
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
    pub(crate) prior: &'c NamedPrior,
    pub(crate) error_bar: ErrorBar,
    pub(crate) allowance: Allowance,
    pub(crate) preset: Preset,
    pub(crate) config: Config,
    /// Everything but the photograph that the results depend on.
    pub(crate) settings: String,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Marker<R = Row> {
    /// Settings and the content of the photographs.
    pub(crate) made_from: String,
    pub(crate) row: R,
    /// Bytes of the folder's other files.
    files: Contents,
}

impl<R: Serialize> Marker<R> {
    /// Marks a folder as finished, last of its files.
    pub(crate) fn write(place: &Path, made_from: String, row: R) -> Result<()> {
        let files = lengths(place).with_context(|| place.display().to_string())?;
        write_json(&place.join(MARKER), &Self { made_from, row, files })
    }
}

/// Everything but the photograph that the results depend on, files by their content.
pub(crate) fn settings_of(
    args: &RefineArgs,
    preset: Preset,
    config: &Config,
    prior: &NamedPrior,
) -> Result<String> {
    let content = |path: &Option<PathBuf>| -> Result<Option<u32>> {
        let Some(path) = path else { return Ok(None) };
        let bytes =
            fs::read(path).with_context(|| format!("{}: can't be read; check the path", path.display()))?;
        Ok(Some(crc32fast::hash(&bytes)))
    };
    let (camera, origin) = (&args.camera, &prior.origin);
    let mut settings = json!({
        "versions": versions(), "config": config.to_toml()?, "preset": preset.name(),
        "size": (args.size.max_size, args.size.work_size),
        "camera": (content(&camera.intrinsics)?, camera.intrinsics_base, camera.fx, camera.fy, camera.cx, camera.cy, camera.fov),
        "prior": (origin.kind, &origin.model, &origin.model_hash, &origin.runtime),
        "error_bar": (args.error_bar.interval, content(&args.error_bar.calibration)?),
        "output": (format!("{:?}", args.export.export), args.save_field),
    });
    if args.several.same_scale {
        settings["same_scale"] = json!(true);
    }
    Ok(settings.to_string())
}

impl Common<'_> {
    /// Refines a photograph, unless its folder is finished. What fails is in the row.
    pub(crate) fn one(&self, item: &Item) -> Row {
        let made = self.made(item, &mut Progress::silent());
        made.unwrap_or_else(|error| Row::failed(item, &crate::program::message(&error)))
    }

    /// The bytes of a photograph.
    pub(super) fn read(&self, item: &Item) -> Result<Vec<u8>> {
        ensure!(item.path.is_file(), "no such photograph; check the path");
        fs::read(&item.path).context("can't be read")
    }

    /// The memory of a photograph's refinement once it is free, and its predictions at once.
    pub(super) fn take(&self, item: &Item) -> Result<(Taken<'_>, usize)> {
        let (args, path) = (self.args, &item.path);
        // By the header alone; what has no header fails when it is decoded.
        let [width, height] = image_size(path).unwrap_or_default();
        let sizes = sizes(&args.size);
        let size = sizes.of_results((height, width));
        let at = sizes.of_refinement(size);
        let memory =
            PhotographMemory::new(&self.config, &*self.prior.prior, size, at, rayon::current_num_threads());
        let at_once =
            memory.predictions_at_once(&limit(&args.size.memory), &path.display().to_string(), at)?;
        let bytes = memory.bytes((at.0 * at.1) as u64, at_once as u64) - memory.shared();
        Ok((self.allowance.take(bytes), at_once))
    }

    /// The photograph of that content at its size, and the prior for it.
    pub(super) fn opened(
        &self,
        item: &Item,
        bytes: Vec<u8>,
        progress: &mut Progress,
    ) -> Result<(Opened, BoundPrior<'_>)> {
        let photo = decode_image(&bytes).map_err(|error| match error {
            mde_prior::Error::Input(reason) => anyhow::anyhow!(reason),
            other => other.into(),
        })?;
        drop(bytes);
        let opening = Opening { size: &self.args.size, camera: &self.args.camera, several: false };
        let mut opened = opening.of(photo, &item.path, progress)?;
        let prior = self.prior.bind(&opened, progress)?;
        self.prior.exchanged().into_iter().for_each(|warning| progress.warn(warning.to_owned()));
        opened.take_camera_of(&prior, &self.prior.origin)?;
        let prior = prior.at_focal(opened.camera.focal());
        Ok((opened, prior))
    }

    /// Everything that the results depend on, the photograph by its content.
    fn made_from(&self, item: &Item, bytes: &[u8]) -> String {
        let made_from = format!("{} {:08x} {}", self.settings, crc32fast::hash(bytes), bytes.len());
        match &item.same_scale {
            Some(same_scale) => format!("{made_from} {}", same_scale.key()),
            None => made_from,
        }
    }

    fn made(&self, item: &Item, progress: &mut Progress) -> Result<Row> {
        let args = self.args;
        let Item { path, folder, same_scale, .. } = item;
        let shown = || path.display().to_string();
        let place = self.output.join(folder);
        // First of all: a plan of the predictions takes as long as thousands of markers.
        let marker = read_marker::<Row>(&place).filter(|_| !args.run.force);
        if let Some(marker) = marker
            && marker.made_from == self.made_from(item, &self.read(item)?)
        {
            let same_scale_group = same_scale.map(|found| found.group);
            return Ok(Row {
                photograph: shown(),
                folder: folder.clone(),
                kept: true,
                same_scale_group,
                ..marker.row
            });
        }
        ensure!(path.is_file(), "no such photograph; check the path");
        let (_taken, at_once) = self.take(item)?;
        let start = Instant::now();
        let bytes = self.read(item)?;
        let made_from = self.made_from(item, &bytes);
        let (opened, prior) = self.opened(item, bytes, progress)?;
        let job = Job {
            command: "refine",
            input: shown(),
            opened,
            prior,
            preset: self.preset,
            config: self.config.clone(),
            truth: None,
            at_once,
            save_field: args.save_field,
            error_bar: self.error_bar.clone(),
            export: args.export.export.clone(),
            capture: None,
            unit: args.several.unit,
            known: None,
            same_scale: *same_scale,
            keep_photographs: false,
        };
        let mut row = Row {
            photograph: shown(),
            folder: folder.clone(),
            unit: job.unit().to_owned(),
            same_scale_group: same_scale.map(|found| found.group),
            ..Row::default()
        };
        job.produce(&OutputFolder::new(&place, true)?, progress, |path, done, progress| {
            write_rgb_png(path.join(THUMBNAIL), thumbnail(done)?.view())?;
            row.measure(done, progress);
            row.seconds = start.elapsed().as_secs_f64();
            Marker::write(path, made_from, row.clone())
        })?;
        Ok(row)
    }
}

impl Row {
    fn measure(&mut self, done: &Done<'_>, progress: &Progress) {
        let camera = &done.camera;
        let depth = &done.result.refinement.depth;
        (self.width, self.height) = (camera.camera.width, camera.camera.height);
        (self.fx, self.camera) = (Some(camera.camera.fx), camera.source.name().to_owned());
        self.median_depth = median(depth.mean().iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)));
        self.same_scale = done.result.same_scale.map(|found| found.factor);
        self.same_scale_sigma = done.result.same_scale.map(|found| found.log_sigma);
        self.sigma = relative_sigma(depth);
        let sigma = depth.sigma();
        let mut relative: Vec<f32> = depth
            .mean()
            .iter()
            .zip(&sigma)
            .filter(|(z, s)| **z > 0.0 && s.is_finite())
            .map(|(z, s)| s / z)
            .collect();
        self.sigma_90 = quantile(&mut relative, 0.9);
        self.missing = sigma.iter().filter(|s| s.is_infinite()).count();
        self.warnings = progress.warnings().to_vec();
    }
}

/// The marker of a folder whose files are there with the lengths that they were written with.
pub(crate) fn read_marker<R: DeserializeOwned>(place: &Path) -> Option<Marker<R>> {
    let marker: Marker<R> = serde_json::from_str(&fs::read_to_string(place.join(MARKER)).ok()?).ok()?;
    have_lengths(place, &marker.files).then_some(marker)
}

/// Photograph, depth and sigma / depth side by side.
fn thumbnail(done: &Done<'_>) -> Result<Array3<u8>> {
    let (rows, columns, _) = done.image.dim();
    let width = (columns * HEIGHT / rows.max(1)).clamp(1, 4 * HEIGHT);
    let small =
        |picture: ArrayView3<'_, u8>| resized(picture.mapv(|v| f32::from(v) / 255.0).view(), width, HEIGHT);
    let depth = &done.result.refinement.depth;
    let relative = ndarray::Zip::from(depth.mean())
        .and(&depth.sigma())
        .map_collect(|z, s| if *z > 0.0 { s / z } else { f32::INFINITY });
    let range = usual_range(relative.iter());
    let parts = [
        resized(done.image, width, HEIGHT),
        small(depth_picture(depth.mean()).pixels()),
        small(sigma_picture_within(relative.view(), range).pixels()),
    ];
    let strip = concatenate(Axis(1), &parts.each_ref().map(|part| part.view()))?;
    Ok(strip.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8))
}
