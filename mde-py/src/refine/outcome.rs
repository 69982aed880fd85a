//! What a run gives back: maps, the record, pictures.

use super::{Object, Watched};
use mde_cli::config::Preset;
use mde_cli::error::{Error, Result};
use mde_cli::mde_prior::{Certainty, CertaintyMeaning};
use mde_cli::mde_warp::PinholeCamera;
use mde_cli::output::preview::strip;
use mde_cli::output::record::{About, RunRecord};
use mde_cli::refiner::finish::Finished;
use mde_cli::refiner::run::{Done, Run, bytes};
use ndarray::{Array2, Array3};
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

/// What the record has beside the result.
pub(super) struct Recorded<'r> {
    pub(super) preset: Preset,
    pub(super) input: &'r str,
    pub(super) watch: &'r Watched<'r>,
    /// Of the run.
    pub(super) seconds: f64,
}

impl Outcome {
    pub(super) fn new(run: &Run<'_>, done: Done<'_>, recorded: &Recorded<'_>) -> Result<Self> {
        let about = About {
            versions: BTreeMap::from([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]),
            preset: Some(recorded.preset.name()),
            seed: Some(run.finish.config.seed),
            warnings: &recorded.watch.warnings,
            total_seconds: recorded.seconds,
            ..About::new("refine", recorded.input.to_owned(), &done.camera)
        };
        let (origin, training) = (run.finish.origin, &recorded.watch.training);
        let record = RunRecord::<()>::new(about, origin, &done.result, training, done.prior_seconds);
        let record = serde_json::to_string(&record).map_err(Error::external)?;
        let config = run.settings(&done)?;
        let (pictures, image) = (done.pictures(), done.image);
        let strip = strip(&done.shown(), image.dim().1);
        let field =
            done.field.filter(|_| run.keeps_field).map(|field| field.lock().to_bytes()).transpose()?;
        let Finished { refinement, stated, .. } = done.result;
        let evidence = refinement.capture.as_ref().and_then(|capture| capture.evidence.as_ref());
        let evidence = evidence.iter().flat_map(|evidence| evidence.arrays()).collect();
        let interval = stated.interval.map(|interval| interval.bounds(&refinement.depth));
        let [lower, upper] = interval.map_or([None, None], |ends| ends.map(Some));
        let [confidence, error] = match refinement.certainty {
            Some(Certainty { meaning: CertaintyMeaning::Error, map }) => [None, Some(map)],
            own => [own.map(|own| own.map), None],
        };
        let sigma = refinement.depth.sigma();
        let (depth, variance) = refinement.depth.into_parts();
        let bytes = bytes(image);
        let exact = image.iter().zip(&bytes).any(|(value, byte)| *value != f32::from(*byte) / 255.0);
        Ok(Self {
            maps: vec![
                ("depth", depth),
                ("variance", variance),
                ("sigma", sigma),
                ("prior", refinement.prior),
            ],
            more: vec![("lower", lower), ("upper", upper), ("confidence", confidence), ("error", error)],
            components: refinement.components.into_iter().map(|part| (part.name, part.sigma)).collect(),
            evidence,
            image: bytes,
            exact: exact.then(|| image.to_owned()),
            camera: done.camera.camera,
            run: record,
            config,
            pictures,
            strip,
            field,
        })
    }
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
