//! One refinement: its steps, the files of its folder, and its scores against ground truth.

use crate::output::export::Format;
use crate::output::files::{Beside, ResultFiles};
use crate::output::preview::strip;
use crate::output::record::RunRecord;
use crate::program::store::{OutputFolder, RECORD};
use crate::program::{Progress, about, line_of, report, summary, write_json};
use crate::refiner::{Plan, Prepared, Refined, Refiner};
use crate::reports::Refinement;
use crate::scene::Scene;
use anyhow::{Context, Result, ensure};
use mde_eval::align::AlignmentRule;
use mde_eval::score::Subject;
use mde_eval::table::{Comparison, Document};
use mde_prior::DepthKind;
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::photo::write_image;
use mde_prior::resample::nearest;
use ndarray::Array2;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::time::Instant;

/// A refinement with what is written of it.
pub(crate) struct Job<'p> {
    pub(crate) command: &'static str,
    pub(crate) refiner: &'p Refiner<'p>,
    pub(crate) export: &'p [Format],
    pub(crate) truth: Option<Truth>,
    /// Whether the photographs are written too, as they are.
    pub(crate) keep_photographs: bool,
}

impl Job<'_> {
    /// Refines the scene's reference, scores, writes and prints. Returns why no further photograph was of use, where there were some.
    pub(crate) fn run(
        &self,
        scene: &Scene,
        plan: &Plan,
        input: &str,
        folder: &OutputFolder,
        progress: &mut Progress,
    ) -> Result<Option<String>> {
        let mut prepared = self.refiner.prepare(scene, plan, progress)?.once();
        let (refined, scores) = self.produce(&mut prepared, 0, input, folder, progress, |_, _, _| Ok(()))?;
        let table = scores.as_ref().map(|scores| scores.table().text() + "\n").unwrap_or_default();
        let mut gained = summary::summary(&refined);
        if let Some(interval) = &refined.stated.interval {
            gained += &format!(
                "\nlower.npy and upper.npy: {:.0} % interval, the depth -+ {:.2} sigma, by {}",
                100.0 * interval.probability,
                interval.half_width,
                interval.by
            );
        }
        let report = folder.path().join(report::FILE);
        let text = format!(
            "{table}{gained}\nwrote {} in {:.1} s; open {} in a browser",
            line_of(folder.path()),
            progress.seconds(),
            line_of(&report)
        );
        progress.done(&Document::default(), &text, folder.path(), json!({ "scores": scores }));
        Ok(refined.refinement.capture.and_then(|report| report.fallback))
    }

    /// Refines a photograph, scores and writes; `last` adds files to the folder before it gets its name.
    pub(crate) fn produce<'s>(
        &self,
        prepared: &mut Prepared<'s>,
        photograph: usize,
        input: &str,
        folder: &OutputFolder,
        progress: &mut Progress,
        last: impl FnOnce(&Path, &Refined<'s>, &Progress) -> Result<()>,
    ) -> Result<(Refined<'s>, Option<Comparison>)> {
        let refined = prepared.refine(photograph, None, progress)?;
        let start = Instant::now();
        let mut scores = None;
        if let Some(truth) = &self.truth {
            progress.step("score");
            scores = Some(truth.compare(&refined.refinement, refined.origin.kind)?);
        }
        let score_seconds = start.elapsed().as_secs_f64();
        folder.write(|path| {
            self.write_files(path, &refined)?;
            let (camera, settings) = (&refined.camera, self.refiner.settings());
            let about = about(self.command, input.to_owned(), camera, Some(settings), progress);
            let record = RunRecord {
                scores: scores.as_ref(),
                score_seconds,
                ..RunRecord::new(about, &refined, &progress.training)
            };
            write_json(&path.join(RECORD), &record)?;
            report::write(path)?;
            last(path, &refined, progress)
        })?;
        Ok((refined, scores))
    }

    /// All files of the refinement but its record and its page.
    fn write_files(&self, path: &Path, refined: &Refined<'_>) -> Result<()> {
        let settings = self.refiner.settings();
        let Refinement { depth, prior, components, certainty, capture, .. } = &refined.refinement;
        let sigma = depth.sigma();
        let bounds = refined.stated.interval.as_ref().map(|interval| interval.bounds(depth));
        let mut more = Vec::new();
        if let Some([lower, upper]) = &bounds {
            more.extend([("lower", lower.view()), ("upper", upper.view())]);
        }
        more.extend(self.truth.as_ref().map(|truth| ("gt", truth.depth.view())));
        let evidence = capture.as_ref().and_then(|capture| capture.evidence.as_ref());
        let metric = refined.origin.kind == DepthKind::Metric;
        let camera = refined.camera.camera;
        let with_others =
            self.export.iter().any(|format| matches!(format, Format::Colmap | Format::Transforms));
        let beside = Beside {
            more,
            components: components.iter().map(|part| (part.name, part.sigma.view())).collect(),
            certainty: certainty.as_ref().map(|own| (own.meaning, own.map.view())),
            evidence: evidence.iter().flat_map(|evidence| evidence.arrays()).collect(),
            pictures: refined.pictures(),
            others: if with_others { refined.others() } else { Vec::new() },
            strip: strip(&refined.shown(), refined.image.dim().1),
            truth: self.truth.as_ref().filter(|_| metric).map(|truth| truth.depth.view()),
        };
        let (sigma, prior, image, png) = (sigma.view(), prior.view(), refined.image.view(), refined.png);
        let files = ResultFiles { depth, sigma, prior, image, camera, png, beside };
        files.write(path)?;
        let config = refined.config_toml(&settings.config)?;
        mde_prior::write_atomic(&path.join("config.toml"), config.as_bytes())?;
        if self.keep_photographs && refined.scene.is_several() {
            let place = path.join("photographs");
            fs::create_dir_all(&place).with_context(|| place.display().to_string())?;
            for photograph in &refined.scene.photographs {
                write_image(place.join(&photograph.name), photograph.image.read()?.view())?;
            }
        }
        let field = refined.refinement.field.as_ref().filter(|_| settings.keep_field);
        if let Some(bytes) = field.and_then(|field| field.to_file()) {
            mde_prior::write_atomic(&path.join("field.safetensors"), &bytes)?;
        }
        let mut formats = self.export.iter().filter(|format| !format.is_of_capture());
        Ok(formats.try_for_each(|format| files.export(*format, path))?)
    }
}

pub(crate) struct Truth {
    pub(crate) source: String,
    /// Metres, `[height, width]`; 0 = missing.
    pub(crate) depth: Array2<f32>,
}

impl Truth {
    /// The map that `--gt` names for an image of `(height, width)`, resized.
    pub(crate) fn open(path: &Path, size: (usize, usize), to: (usize, usize)) -> Result<Self> {
        let (source, depth) = (path.display().to_string(), read_depth(path, &ReadOptions::default())?);
        let ((height, width), (rows, columns)) = (size, depth.dim());
        ensure!(
            depth.dim() == size,
            "{source}: the truth is {columns}x{rows} but the image is {width}x{height} (width x height); make both the same size"
        );
        Ok(Self { source, depth: nearest(depth.view(), to) })
    }

    /// Scores of prior and refined depth, each under its own alignment, by three rules.
    pub(crate) fn compare(&self, refinement: &Refinement, kind: DepthKind) -> Result<Comparison> {
        let sigma = refinement.depth.sigma();
        let prior = Subject::new(refinement.prior.view(), self.depth.view());
        let refined = Subject::new(refinement.depth.mean(), self.depth.view()).with_sigma(sigma.view());
        Comparison::new(&self.source, &prior, &refined, rules(kind)).with_context(|| self.source.clone())
    }
}

/// The first is printed.
fn rules(kind: DepthKind) -> [AlignmentRule; 3] {
    use AlignmentRule::{LeastSquaresDisparity, MedianRatio, None};
    match kind {
        DepthKind::AffineDisparity => [LeastSquaresDisparity, MedianRatio, None],
        _ => [MedianRatio, None, LeastSquaresDisparity],
    }
}
