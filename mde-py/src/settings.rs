//! Settings of a run: a preset and what overrides it.

use crate::error::raise;
use mde_cli::config::Preset;
use mde_cli::mde_prior::augment::Predictions;
use mde_cli::refiner::error_bar::ErrorBar;
use mde_cli::refiner::plan::limit::MemoryLimit;
use mde_cli::refiner::{self, Unit};
use mde_cli::scene::size::{SMALLEST, Sizes};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Everything that a refiner is set to.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Settings(pub(crate) refiner::Settings);

/// Settings by the names of their arguments.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Given {
    preset: String,
    /// By its form: `toml`, `json`, or `file`, whose path it is.
    config: String,
    form: String,
    seed: Option<u64>,
    no_nerf: bool,
    /// A number, or `auto`.
    predictions: Option<String>,
    /// Nearest and farthest depth, metres.
    depth_range: Option<[f64; 2]>,
    max_size: Option<usize>,
    /// Million pixels.
    work_size: f64,
    /// GiB.
    max_memory: f64,
    interval: Option<f64>,
    calibration: Option<PathBuf>,
    unit_of_poses: bool,
    keep_field: bool,
}

#[pymethods]
impl Settings {
    #[new]
    fn new(given: Given) -> PyResult<Self> {
        let preset = Preset::ALL.into_iter().find(|one| one.name() == given.preset).ok_or_else(|| {
            let names = Preset::ALL.map(Preset::name).join(", ");
            raise(format!("preset is {:?}; give one of: {names}", given.preset))
        })?;
        let config = preset.config();
        let text = given.config;
        let config = match &*given.form {
            "file" => config.with_file(Path::new(&text)),
            "json" => {
                let table: toml::Table = serde_json::from_str(&text)
                    .map_err(|e| raise(format!("config: {e}; give numbers, texts, lists and tables")))?;
                config.with_text(&table.to_string(), "config")
            }
            _ => config.with_text(&text, "config"),
        };
        let config = config.map_err(raise)?;
        let predictions = given.predictions.as_deref().map(Predictions::from_str).transpose();
        let predictions = predictions.map_err(|text| raise(format!("predictions: {text}")))?;
        let Given { seed, no_nerf, depth_range, .. } = given;
        let config = config.with(seed, no_nerf, predictions, depth_range).map_err(raise)?;
        for (name, value, unit) in
            [("work_size", given.work_size, "million pixels"), ("max_memory", given.max_memory, "GiB")]
        {
            if !(value > 0.0 && value.is_finite()) {
                return Err(raise(format!("{name} is {value}; give a positive number of {unit}")));
            }
        }
        if given.max_size.is_some_and(|side| side < SMALLEST) {
            return Err(raise(format!("max_size is too small; give {SMALLEST} pixels or more")));
        }
        if let Some(probability) = given.interval.filter(|probability| !(0.01..=0.99).contains(probability)) {
            return Err(raise(format!("interval is {probability}; give 0.01 to 0.99, such as 0.9")));
        }
        Ok(Self(refiner::Settings {
            preset,
            config,
            sizes: Sizes { longest: given.max_size, megapixels: given.work_size },
            memory: MemoryLimit { gib: given.max_memory },
            error_bar: ErrorBar::open(given.interval, given.calibration.as_deref()).map_err(raise)?,
            unit: if given.unit_of_poses { Unit::Capture } else { Unit::Prior },
            exports: false,
            keep_field: given.keep_field,
        }))
    }
}
