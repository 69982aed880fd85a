//! What a run gives back: maps, the record, pictures.

use super::{Object, Watch};
use crate::error::message;
use crate::settings::Settings;
use mde_cli::inputs::size::thumbnail;
use mde_cli::inputs::{KnownCamera, PriorOrigin};
use mde_cli::mde_prior::augment::Predictions;
use mde_cli::mde_warp::PinholeCamera;
use mde_cli::results::preview::strip;
use mde_cli::results::{About, Finished, RunRecord};
use mde_cli::{Capture, CaptureReport};
use ndarray::{Array2, Array3, ArrayView3};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::collections::BTreeMap;

/// The parts of a result.
pub(super) struct Outcome {
    maps: Vec<(&'static str, Array2<f32>)>,
    /// Maps that a result may have.
    more: Vec<(&'static str, Option<Array2<f32>>)>,
    components: Vec<(&'static str, Array2<f32>)>,
    evidence: Vec<(&'static str, Array2<f32>)>,
    image: Array3<u8>,
    /// The image, where bytes do not hold it.
    exact: Option<Array3<f32>>,
    camera: PinholeCamera,
    run: String,
    config: String,
    pictures: Vec<(String, Array3<u8>)>,
    strip: Vec<Array3<f32>>,
    /// The file of the fitted field.
    field: Option<Vec<u8>>,
}

/// A run that is done.
pub(super) struct Done<'d> {
    pub(super) origin: PriorOrigin,
    pub(super) settings: &'d Settings,
    pub(super) watch: Watch<'d>,
    pub(super) result: Finished,
    pub(super) known: KnownCamera,
    pub(super) capture: Option<Capture>,
    pub(super) field: Option<Vec<u8>>,
    pub(super) input: &'d str,
    /// At the size of the maps.
    pub(super) image: ArrayView3<'d, f32>,
    /// Of the run, and of the predictions.
    pub(super) seconds: (f64, f64),
}

impl Done<'_> {
    pub(super) fn outcome(self) -> Result<Outcome, String> {
        let Self { origin, settings, mut watch, result, known, capture, image, seconds, .. } = self;
        watch.warnings.extend(result.png.warning());
        let mut config = settings.config.clone();
        let about = About {
            versions: BTreeMap::from([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]),
            preset: Some(settings.preset.name()),
            seed: Some(config.seed),
            warnings: &watch.warnings,
            total_seconds: seconds.0,
            ..About::new("refine", self.input.to_owned(), &known)
        };
        let record = RunRecord::<()>::new(about, &origin, &result, &watch.training, seconds.1);
        let run = serde_json::to_string(&record).map_err(message)?;
        if settings.budget.is_some() {
            // The clock chose the number; with it the run repeats.
            config.augmentation.predictions =
                Predictions::Most(result.refinement.augmentation.predictions as u32);
        }
        let refinement = result.refinement;
        let (mut pictures, mut evidence, mut above) = (Vec::new(), Vec::new(), Vec::new());
        if let Some((capture, report)) = capture.as_ref().zip(refinement.capture.as_ref()) {
            pictures = thumbnails(capture, report);
            evidence = report.evidence.iter().flat_map(|evidence| evidence.arrays()).collect();
            let others = capture.photographs.iter().zip(&report.photographs).skip(1);
            let used = others.filter(|(_, report)| report.used).map(|(one, _)| one.image.view());
            let shown: Vec<_> = std::iter::once(image).chain(used).collect();
            above = strip(&shown, image.dim().1);
        }
        let interval = result.stated.interval.map(|interval| interval.bounds(&refinement.depth));
        let [lower, upper] = interval.map_or([None, None], |ends| ends.map(Some));
        let sigma = refinement.depth.sigma();
        let (depth, variance) = refinement.depth.into_parts();
        let bytes = bytes(image);
        let exact = image.iter().zip(&bytes).any(|(value, byte)| *value != f32::from(*byte) / 255.0);
        Ok(Outcome {
            maps: vec![
                ("depth", depth),
                ("variance", variance),
                ("sigma", sigma),
                ("prior", refinement.prior),
            ],
            more: vec![("lower", lower), ("upper", upper), ("confidence", refinement.confidence)],
            components: refinement.components.into_iter().map(|part| (part.name, part.sigma)).collect(),
            evidence,
            image: bytes,
            exact: exact.then(|| image.to_owned()),
            camera: known.camera,
            run,
            config: config.to_toml().map_err(message)?,
            pictures,
            strip: above,
            field: self.field,
        })
    }
}

/// The pictures of `views/`, by their names.
fn thumbnails(capture: &Capture, report: &CaptureReport) -> Vec<(String, Array3<u8>)> {
    let small = |image: &Array3<f32>| bytes(thumbnail(image.view()).view());
    let photographs = capture.photographs.iter().enumerate();
    let mut pictures: Vec<_> =
        photographs.map(|(index, one)| (format!("views/{index:02}.png"), small(&one.image))).collect();
    if let Some(novel) = &report.novel {
        pictures.push(("views/novel.png".to_owned(), bytes(novel.image.view())));
        pictures.push(("views/rendered.png".to_owned(), bytes(novel.rendered.view())));
    }
    pictures
}

/// sRGB in 0 to 1 as bytes.
fn bytes(image: ArrayView3<'_, f32>) -> Array3<u8> {
    image.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}

impl Outcome {
    pub(super) fn into_dict(self, py: Python<'_>) -> PyResult<Object<'_>> {
        let parts = PyDict::new(py);
        for (name, map) in self.maps {
            parts.set_item(name, map.into_pyarray(py))?;
        }
        for (name, map) in self.more {
            parts.set_item(name, map.map(|map| map.into_pyarray(py)))?;
        }
        for (name, group) in [("components", self.components), ("evidence", self.evidence)] {
            let by_name = PyDict::new(py);
            for (name, map) in group {
                by_name.set_item(name, map.into_pyarray(py))?;
            }
            parts.set_item(name, by_name)?;
        }
        parts.set_item("image", self.image.into_pyarray(py))?;
        parts.set_item("exact", self.exact.map(|image| image.into_pyarray(py)))?;
        let PinholeCamera { fx, fy, cx, cy, width, height } = self.camera;
        parts.set_item("camera", (fx, fy, cx, cy, width, height))?;
        parts.set_item("run", self.run)?;
        parts.set_item("config", self.config)?;
        let pictures = PyDict::new(py);
        for (name, picture) in self.pictures {
            pictures.set_item(name, picture.into_pyarray(py))?;
        }
        parts.set_item("pictures", pictures)?;
        let strip = self.strip.into_iter().map(|picture| picture.into_pyarray(py));
        parts.set_item("strip", PyList::new(py, strip.collect::<Vec<_>>())?)?;
        parts.set_item("field", self.field.map(|field| PyBytes::new(py, &field)))?;
        Ok(parts.into_any())
    }
}
