//! From a refinement to a result: its unit, its error bar, its scale by known depths, and warnings.

use crate::config::Config;
use crate::error::{Error, Result, text};
use crate::prior::{METRES, PriorForm, PriorOrigin};
use crate::refinement::scale::ScaleReport;
use crate::refiner::plausibility::{contradicted, doubts};
use crate::refiner::{Prepared, Settings, Stated};
use crate::reports::{CaptureReport, Component, Refinement};
use crate::scene::{Image, KnownCamera, Photograph, SameScale, Scene, byte, thumbnail};
use mde_prior::DepthKind;
use mde_prior::format::DepthPng;
use mde_prior::pixels::RECENT;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose};
use ndarray::Array3;
use serde::Serialize;
use std::path::Path;

/// Unit of a result of several photographs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "program", derive(clap::ValueEnum))]
pub enum Unit {
    /// The prior's unit: metres for a metric prior.
    #[default]
    Prior,
    /// The unit of the poses that the capture came with.
    Capture,
}

/// How the result came to its unit, for the record.
#[derive(Debug, Clone, Serialize)]
pub struct Scaled {
    /// The file or folder, or `array`.
    pub from: String,
    /// The map to the known depths.
    #[serde(flatten)]
    pub report: ScaleReport,
}

/// Another photograph of several, in the frame of the one that is refined.
#[derive(Debug, Clone)]
pub struct Other {
    /// Name of its file.
    pub name: String,
    /// `[height, width, 3]`.
    pub picture: Array3<u8>,
    /// The camera of the picture.
    pub camera: PinholeCamera,
    /// World to camera, in the unit of the refined depth.
    pub pose: Pose,
}

/// A refinement in its unit and with its error bar; serialised, it is what the record of a run has of it.
#[derive(Serialize)]
pub struct Refined<'s> {
    /// The photographs.
    #[serde(skip)]
    pub scene: &'s Scene,
    /// Index of the refined one.
    #[serde(skip)]
    pub photograph: usize,
    /// It at the size of the maps, sRGB in 0 to 1, `[height, width, 3]`.
    #[serde(skip)]
    pub image: Image,
    /// Indices and images of the other photographs that were used.
    #[serde(skip)]
    pub used: Vec<(usize, Image)>,
    /// Its camera.
    #[serde(skip)]
    pub camera: KnownCamera,
    /// Where the prior comes from.
    #[serde(rename = "prior")]
    pub origin: PriorOrigin,
    /// Unit of the maps: `m`, `capture` or `unscaled`.
    pub unit: &'static str,
    /// Unit and scale of `depth.png`.
    #[serde(flatten)]
    pub png: DepthPng,
    /// The error bar.
    #[serde(rename = "error_bar")]
    pub stated: Stated,
    /// How known depths gave the scale.
    #[serde(rename = "scale", skip_serializing_if = "Option::is_none")]
    pub scaled: Option<Scaled>,
    /// The factor to the scale in common with other photographs, of the refined map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub same_scale: Option<SameScale>,
    /// The maps, and what the steps found.
    #[serde(flatten)]
    pub refinement: Refinement,
    /// Seconds of the prior's predictions.
    pub prior_seconds: f64,
}

impl<'s> Prepared<'s> {
    /// The unit of the results: that of the settings, but of photographs with poses and without a prior that of the poses.
    fn result_unit(&self) -> Unit {
        match self.origin().form == PriorForm::Nothing && self.scene.is_posed() {
            true => Unit::Capture,
            false => self.refiner.settings.unit,
        }
    }

    /// Unit of the results: `m`, `capture` or `unscaled`.
    pub fn unit(&self) -> &'static str {
        self.name_of(self.result_unit())
    }

    fn name_of(&self, unit: Unit) -> &'static str {
        match (&self.scene.known, unit, self.origin().kind) {
            (Some(known), ..) if known.of_model => "capture",
            (Some(_), ..) => METRES,
            (None, Unit::Capture, _) => "capture",
            (None, Unit::Prior, DepthKind::Metric) => METRES,
            (None, Unit::Prior, _) => "unscaled",
        }
    }

    /// Turns the refinement of a photograph with its camera into the result. The camera becomes the one that was estimated with the poses.
    pub(super) fn finish(
        &self,
        mut refinement: Refinement,
        photograph: usize,
        (image, camera): (Image, KnownCamera),
        warn: &mut dyn FnMut(String),
    ) -> Result<Refined<'s>> {
        let (scene, origin) = (self.scene, self.origin());
        let reports = refinement.capture.iter().flat_map(|report| &report.photographs).enumerate();
        let others = reports.filter(|(index, report)| report.used && *index != photograph);
        let others: Result<_> =
            others.map(|(index, _)| Ok((index, scene.photographs[index].image.read()?))).collect();
        let Settings { config, error_bar, .. } = &self.refiner.settings;
        let report = refinement.capture.as_ref();
        let used = report.is_some_and(|report| report.fallback.is_none());
        if let Some(reason) = report.and_then(|report| report.fallback.as_ref()) {
            warn(format!("{{views}}: {reason}; only the reference photograph was used"));
        }
        if let Some(moved) = report.map(|report| report.moved.join(", ")).filter(|moved| !moved.is_empty()) {
            warn(format!(
                "{moved}: the matches contradict the given poses; theirs are used, and the unit may be off: check that the poses belong to the photographs and have the axes of their format"
            ));
        }
        report.filter(|_| used).and_then(CaptureReport::lens_warning).into_iter().for_each(&mut *warn);
        let estimated = report.filter(|_| used).and_then(|report| report.photographs.get(photograph)?.camera);
        let camera = camera.or_estimated(estimated, report.and_then(|report| report.focal_sigma));
        // Refused photographs have no unit.
        let mut unit = self.result_unit();
        if unit == Unit::Capture && used {
            refinement = refinement.in_capture_unit()?;
        } else if unit == Unit::Capture && refinement.capture.is_some() {
            warn("{unit}: without poses that fit there is no unit but the prior's".to_owned());
            unit = Unit::Prior;
        }
        let scaled = scene.known.is_some();
        doubts(&refinement.prior, origin, config, scaled).into_iter().for_each(&mut *warn);
        if used && unit == Unit::Prior && !scaled {
            contradicted(&refinement, origin).into_iter().for_each(&mut *warn);
        }
        refinement.augmentation.fewer.iter().cloned().for_each(&mut *warn);
        for (index, iteration) in refinement.iterations.iter().enumerate() {
            for warning in &iteration.fusion.warnings {
                warn(format!("iteration {}: {warning}", index + 1));
            }
        }
        let stated = error_bar.apply(&mut refinement, config, origin, used, scaled)?;
        // Errors of the whole map, which sigma does not contain.
        let of_poses = refinement.capture.as_ref().and_then(|report| report.scale);
        let gauge = of_poses.filter(|_| unit == Unit::Prior && !scaled).map(|[_, relative]| relative);
        let scale = stated.scale.as_ref().map(|scale| scale.relative);
        for (name, relative) in [("gauge", gauge), ("scale", scale)] {
            let Some(relative) = relative.filter(|relative| relative.is_finite()) else { continue };
            let of = |z: &f32| if *z > 0.0 { relative as f32 * z } else { f32::INFINITY };
            let sigma = refinement.depth.mean().map(of);
            refinement.components.push(Component { name, sigma });
        }
        let mut same_scale = scene.same_scale;
        if let Some(found) = same_scale.as_mut().filter(|found| !found.is_alone()) {
            // The factor is that of the plain prediction; the merged one differs by another.
            let both = refinement.prior.iter().zip(refinement.depth.mean());
            let both = both.filter(|(prior, z)| **prior > 0.0 && **z > 0.0);
            found.factor *= median(both.map(|(prior, z)| f64::from(*prior) / f64::from(*z))).unwrap_or(1.0);
            refinement = refinement.scaled(found.factor, found.log_sigma)?;
        }
        let mut by_known = None;
        if let Some(known) = &scene.known {
            let at = known.at(refinement.depth.dim());
            let (refined, report) = refinement.scaled_to(&at, !origin.kind.is_depth()).map_err(|error| {
                Error::Argument(format!("{{scale-from}} {}: {}", known.source, text(&error)))
            })?;
            refinement = refined;
            by_known = Some(Scaled { from: known.source.clone(), report });
        }
        stated.warnings.iter().cloned().for_each(&mut *warn);
        let unit = self.name_of(unit);
        let png = DepthPng::new(unit, refinement.depth.mean().iter().copied());
        png.warning().into_iter().for_each(warn);
        Ok(Refined {
            scene,
            photograph,
            image,
            used: others?,
            camera,
            refinement,
            unit,
            stated,
            scaled: by_known,
            same_scale,
            png,
            origin: origin.clone(),
            prior_seconds: self.prior.take_seconds(),
        })
    }
}

impl<'s> Refined<'s> {
    /// The configuration as TOML, with the number of predictions and its reason in a comment.
    ///
    /// # Errors
    /// Those of [`Config::to_toml`].
    pub fn config_toml(&self, config: &Config) -> Result<String> {
        let report = &self.refinement.augmentation;
        let comment = report.reason.as_ref().map(|reason| {
            let unit = if report.predictions == 1 { "prediction" } else { "predictions" };
            format!("# {} {unit}: {reason}\n", report.predictions)
        });
        Ok(comment.unwrap_or_default() + &config.to_toml()?)
    }

    /// The photographs that were used, this one first.
    pub fn shown(&self) -> Vec<Image> {
        std::iter::once(&self.image).chain(self.used.iter().map(|(_, image)| image)).cloned().collect()
    }

    /// The other photographs that were used and have a place in the frame of this one, each with a name of its own.
    pub fn others(&self) -> Vec<Other> {
        let other = |(index, image): &(usize, Image)| {
            let report = self.refinement.capture.as_ref()?.photographs.get(*index)?;
            let stem = Path::new(&report.name).file_stem()?.to_string_lossy();
            let (name, picture) = (format!("{index:02}-{stem}.png"), image.mapv(byte));
            Some(Other { name, picture, camera: report.camera?, pose: report.pose? })
        };
        self.used.iter().filter_map(other).collect()
    }

    /// Small pictures of several photographs by file names, of a long capture of those used, and the novel view beside its rendering.
    pub fn pictures(&self) -> Vec<(String, Array3<u8>)> {
        let Some(report) = &self.refinement.capture else { return Vec::new() };
        let few = report.photographs.len() <= RECENT;
        let small = |(index, one): (usize, &Photograph)| {
            let image = (few || report.photographs.get(index)?.used).then(|| one.image.read().ok())??;
            Some((picture_of(index), thumbnail(image.view()).mapv(byte)))
        };
        let mut pictures: Vec<_> = self.scene.photographs.iter().enumerate().filter_map(small).collect();
        if let Some(novel) = &report.novel {
            pictures.push((NOVEL.to_owned(), novel.image.mapv(byte)));
            pictures.push((RENDERED.to_owned(), novel.rendered.mapv(byte)));
        }
        pictures
    }
}

/// The folder of [`Refined::pictures`].
pub const PICTURES: &str = "views";
/// The photograph that the field renders.
pub const NOVEL: &str = "views/novel.png";
/// Its rendering.
pub const RENDERED: &str = "views/rendered.png";

/// The small picture of a photograph.
pub fn picture_of(index: usize) -> String {
    format!("{PICTURES}/{index:02}.png")
}
