//! What a run gives back: maps, the record, pictures.

use super::{Object, Watched, parts_of};
use crate::error::keywords;
use mde_cli::error::{Error, Result};
use mde_cli::mde_prior::{Certainty, CertaintyMeaning};
use mde_cli::mde_warp::PinholeCamera;
use mde_cli::output::preview::strip;
use mde_cli::output::record::{About, RunRecord};
use mde_cli::refiner::finish::Other;
use mde_cli::refiner::{Refined, Refiner};
use mde_cli::scene::camera::KnownCamera;
use mde_cli::scene::size::byte;
use ndarray::{Array2, Array3};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBytes};
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// The parts of a result, by the names of their fields in Python.
pub(super) struct Outcome {
    maps: Vec<(&'static str, Option<Array2<f32>>)>,
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
    others: Vec<Other>,
    /// The file of the fitted field.
    field: Option<Vec<u8>>,
}

/// The common part of a record, of a run since `start`.
pub(super) fn about<'r>(
    command: &'static str,
    refiner: &Refiner<'_>,
    input: String,
    camera: &'r KnownCamera,
    watch: &'r Watched<'_>,
    start: Instant,
) -> About<'r> {
    let settings = refiner.settings();
    About {
        versions: BTreeMap::from([(env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION"))]),
        preset: Some(settings.preset.name()),
        seed: Some(settings.config.seed),
        warnings: &watch.warnings,
        total_seconds: start.elapsed().as_secs_f64(),
        ..About::new(command, input, camera)
    }
}

/// A record as JSON.
pub(super) fn json(record: &impl Serialize) -> Result<String> {
    Ok(keywords(&serde_json::to_string(record).map_err(Error::external)?))
}

impl Outcome {
    /// Of the refinement of `input` since `start`.
    pub(super) fn new(
        refiner: &Refiner<'_>,
        refined: Refined<'_>,
        input: String,
        watch: &Watched<'_>,
        start: Instant,
    ) -> Result<Self> {
        let settings = refiner.settings();
        let about = about("refine", refiner, input, &refined.camera, watch, start);
        let run = json(&RunRecord::<()>::new(about, &refined, &watch.training))?;
        let config = refined.config_toml(&settings.config)?;
        let (pictures, shown, others) = (refined.pictures(), refined.shown(), refined.others());
        let Refined { refinement, stated, image, camera, .. } = refined;
        let field = refinement.field.as_ref().filter(|_| settings.keep_field);
        let field = field.and_then(|field| field.to_file());
        let evidence = refinement.capture.as_ref().and_then(|capture| capture.evidence.as_ref());
        let evidence = evidence.iter().flat_map(|evidence| evidence.arrays());
        let evidence = evidence.map(|(name, map)| (name, map.to_owned())).collect();
        let interval = stated.interval.map(|interval| interval.bounds(&refinement.depth));
        let [lower, upper] = interval.map_or([None, None], |ends| ends.map(Some));
        let [confidence, error] = match refinement.certainty {
            Some(Certainty { meaning: CertaintyMeaning::Error, map }) => [None, Some(map)],
            own => [own.map(|own| own.map), None],
        };
        let sigma = refinement.depth.sigma();
        let (depth, variance) = refinement.depth.into_parts();
        let bytes = image.mapv(byte);
        let exact = image.iter().zip(&bytes).any(|(value, byte)| *value != f32::from(*byte) / 255.0);
        Ok(Self {
            maps: vec![
                ("depth", Some(depth)),
                ("_variance", Some(variance)),
                ("sigma", Some(sigma)),
                ("prior", Some(refinement.prior)),
                ("lower", lower),
                ("upper", upper),
                ("_confidence", confidence),
                ("_error", error),
            ],
            components: refinement.components.into_iter().map(|part| (part.name, part.sigma)).collect(),
            evidence,
            image: bytes,
            exact: exact.then(|| image.to_owned()),
            camera: camera.camera,
            run,
            config,
            pictures,
            strip: strip(&shown, image.dim().1),
            others,
            field,
        })
    }

    pub(super) fn into_dict(self, py: Python<'_>) -> PyResult<Object<'_>> {
        let maps = self.maps.into_iter().map(|(name, map)| (name, map.map(|map| map.into_pyarray(py))));
        let parts = maps.into_py_dict(py)?;
        for (name, group) in [("components", self.components), ("evidence", self.evidence)] {
            let by_name = group.into_iter().map(|(name, map)| (name, map.into_pyarray(py)));
            parts.set_item(name, by_name.into_py_dict(py)?)?;
        }
        parts.set_item("image", self.image.into_pyarray(py))?;
        parts.set_item("_exact", self.exact.map(|image| image.into_pyarray(py)))?;
        let camera = |c: PinholeCamera| (c.fx, c.fy, c.cx, c.cy, c.width, c.height);
        parts.set_item("camera", camera(self.camera))?;
        let other =
            |one: Other| (one.name, one.picture.into_pyarray(py), camera(one.camera), parts_of(&one.pose));
        parts.set_item("_others", self.others.into_iter().map(other).collect::<Vec<_>>())?;
        parts.set_item("run", self.run)?;
        parts.set_item("config", self.config)?;
        let pictures = self.pictures.into_iter().map(|(name, picture)| (name, picture.into_pyarray(py)));
        parts.set_item("_pictures", pictures.into_py_dict(py)?)?;
        let strip: Vec<_> = self.strip.into_iter().map(|picture| picture.into_pyarray(py)).collect();
        parts.set_item("_strip", strip)?;
        parts.set_item("field", self.field.map(|field| PyBytes::new(py, &field)))?;
        Ok(parts.into_any())
    }
}
