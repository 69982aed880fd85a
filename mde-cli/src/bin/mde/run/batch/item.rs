//! One of many photographs: its marker, its refinement, its row.

use super::allowance::{Allowance, Taken};
use super::index::Row;
use crate::args::RefineArgs;
use crate::input::camera::{self, KnownCamera};
use crate::input::opened::{Opened, opened};
use crate::input::prior::NamedPrior;
use crate::input::size::{limit, within, working};
use crate::output::folder::OutputFolder;
use crate::output::provenance::{versions, write_json};
use crate::run::every::relative_sigma;
use crate::run::job::{Done, Full, Job};
use crate::run::progress::Progress;
use anyhow::{Context, Result, ensure};
use mde_cli::inputs::size::resized;
use mde_cli::memory::PhotographMemory;
use mde_cli::results::preview::{depth_picture, sigma_picture_within, usual_range};
use mde_cli::results::{ErrorBar, SameScale};
use mde_cli::{Config, Naming, Preset};
use mde_prior::Timed;
use mde_prior::photo::{decode_image, image_size, write_rgb_png};
use mde_uncertainty::statistics::{median, quantile};
use ndarray::{Array3, ArrayView3, Axis, concatenate};
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
    pub(crate) prior: &'c NamedPrior<'c>,
    pub(crate) error_bar: ErrorBar,
    pub(crate) allowance: Allowance,
    pub(crate) preset: Preset,
    pub(crate) config: Config,
    /// Everything but the photograph that the results depend on.
    pub(crate) settings: String,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Marker {
    /// Settings and the content of the photograph.
    made_from: String,
    pub(crate) row: Row,
}

/// Everything but the photograph that the results depend on, files by their content.
pub(crate) fn settings_of(
    args: &RefineArgs,
    preset: Preset,
    config: &Config,
    prior: &NamedPrior<'_>,
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
        "output": (format!("{:?}", args.export.export), args.export.y_up, args.save_field),
    });
    if args.several.same_scale {
        settings["same_scale"] = json!(true);
    }
    // As text: numbers that are read again may differ in their last bit.
    Ok(settings.to_string())
}

impl Common<'_> {
    /// Refines a photograph, unless its folder is finished. What fails is in the row.
    pub(crate) fn one(&self, item: &Item) -> Row {
        let made = self.made(item, &mut Progress::silent());
        made.unwrap_or_else(|error| Row::failed(item, &crate::message(&error)))
    }

    /// The bytes of a photograph, the predictions at once, and the memory of its refinement.
    pub(super) fn read(&self, item: &Item) -> Result<(Taken<'_>, usize, Vec<u8>)> {
        let (args, path) = (self.args, &item.path);
        ensure!(path.is_file(), "no such photograph; check the path");
        // By the header alone; what has no header fails when it is decoded.
        let [width, height] = image_size(path).unwrap_or_default();
        let size = within((height, width), args.size.max_size);
        let at = working(size, &args.size);
        let memory =
            PhotographMemory::new(&self.config, &*self.prior.prior, size, at, rayon::current_num_threads());
        let at_once =
            memory.predictions_at_once(&limit(&args.size.memory), &path.display().to_string(), at)?;
        let bytes = memory.bytes((at.0 * at.1) as u64, at_once as u64) - memory.shared();
        let taken = self.allowance.take(bytes);
        Ok((taken, at_once, fs::read(path).context("can't be read")?))
    }

    /// The photograph at the working size, at that of the results where it is larger, and the camera at the working size.
    pub(super) fn decoded(
        &self,
        item: &Item,
        bytes: Vec<u8>,
        progress: &mut Progress,
    ) -> Result<(Opened, Option<Full>, KnownCamera)> {
        let args = self.args;
        let photo = decode_image(&bytes).map_err(|error| match error {
            mde_prior::Error::Input(reason) => anyhow::anyhow!(reason),
            other => other.into(),
        })?;
        drop(bytes);
        let mut opened = opened(photo, &item.path, &args.size, progress)?;
        let mut full = None;
        if let Some(working) = opened.working(&args.size) {
            let camera = camera::known(&args.camera, opened.photo.focal_35mm, &opened)?;
            full = Some(Full { image: std::mem::replace(&mut opened, working).photo.pixels, camera });
        }
        let mut camera = camera::known(&args.camera, opened.photo.focal_35mm, &opened)?;
        if let Some(own) = self.prior.camera(opened.photo.pixels.view(), &camera)? {
            if let Some(full) = &mut full {
                full.take_camera(&own)?;
            }
            camera = own;
        }
        Ok((opened, full, camera))
    }

    fn made(&self, item: &Item, progress: &mut Progress) -> Result<Row> {
        let Self { args, prior, .. } = self;
        let Item { path, folder, same_scale } = item;
        let shown = || path.display().to_string();
        let (_taken, at_once, bytes) = self.read(item)?;
        let start = Instant::now();
        let mut made_from = format!("{} {:08x} {}", self.settings, crc32fast::hash(&bytes), bytes.len());
        if let Some(same_scale) = same_scale {
            made_from = format!("{made_from} {}", same_scale.key());
        }
        let place = self.output.join(folder);
        if !args.run.force
            && let Some(row) = finished(&place, &made_from)
        {
            let same_scale_group = same_scale.map(|found| found.group);
            return Ok(Row {
                photograph: shown(),
                folder: folder.clone(),
                kept: true,
                same_scale_group,
                ..row
            });
        }
        let (opened, full, camera) = self.decoded(item, bytes, progress)?;
        let prior = prior.for_camera(&camera);
        camera.warning(Naming::Flags).into_iter().for_each(|warning| progress.warn(warning));
        let alone = same_scale.and_then(|found| found.warning(Naming::Flags));
        alone.into_iter().for_each(|warning| progress.warn(warning));
        let job = Job {
            command: "refine",
            input: shown(),
            camera,
            prior: NamedPrior {
                prior: Box::new(Timed::new(&*prior.prior)),
                origin: prior.origin.clone(),
                size: None,
                note: None,
            },
            preset: self.preset,
            config: self.config.clone(),
            truth: None,
            budget: None,
            at_once,
            full,
            save_field: args.save_field,
            checkpoints: None,
            error_bar: self.error_bar.clone(),
            export: args.export.export.clone(),
            y_up: args.export.y_up,
            recording: None,
            capture: None,
            unit: args.several.unit,
            known: None,
            same_scale: *same_scale,
            keep_photographs: false,
            image: opened.photo.pixels,
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
            write_json(&path.join(MARKER), &Marker { made_from, row: row.clone() })
        })?;
        Ok(row)
    }
}

impl Row {
    fn measure(&mut self, done: &Done<'_>, progress: &Progress) {
        let camera = &done.subject.camera;
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

/// The row of a folder that the same inputs and settings made.
fn finished(place: &Path, made_from: &str) -> Option<Row> {
    let marker = read_marker(place)?;
    (marker.made_from == made_from).then_some(marker.row)
}

pub(crate) fn read_marker(place: &Path) -> Option<Marker> {
    serde_json::from_str(&fs::read_to_string(place.join(MARKER)).ok()?).ok()
}

/// Photograph, depth and sigma / depth side by side.
fn thumbnail(done: &Done<'_>) -> Result<Array3<u8>> {
    let (rows, columns, _) = done.subject.image.dim();
    let width = (columns * HEIGHT / rows.max(1)).clamp(1, 4 * HEIGHT);
    let small =
        |picture: ArrayView3<'_, u8>| resized(picture.mapv(|v| f32::from(v) / 255.0).view(), width, HEIGHT);
    let depth = &done.result.refinement.depth;
    let relative = ndarray::Zip::from(depth.mean())
        .and(&depth.sigma())
        .map_collect(|z, s| if *z > 0.0 { s / z } else { f32::INFINITY });
    let range = usual_range(relative.iter());
    let parts = [
        resized(done.subject.image, width, HEIGHT),
        small(depth_picture(depth.mean()).pixels()),
        small(sigma_picture_within(relative.view(), range).pixels()),
    ];
    let strip = concatenate(Axis(1), &parts.each_ref().map(|part| part.view()))?;
    Ok(strip.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8))
}
