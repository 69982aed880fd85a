//! Settings of a run: a preset and what overrides it.

use crate::error::raise;
use mde_cli::config::{Config, Preset, Shorthands};
use mde_cli::mde_prior::augment::Predictions;
use mde_cli::naming::Naming;
use pyo3::prelude::*;
use std::path::Path;
use std::str::FromStr;

/// The preset and the configuration of a run.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Settings {
    pub(crate) preset: Preset,
    pub(crate) config: Config,
}

/// Settings with arguments of their own.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Short {
    seed: Option<u64>,
    no_nerf: bool,
    /// A number, or `auto`.
    predictions: Option<String>,
    /// Metres.
    near: Option<f64>,
    far: Option<f64>,
}

impl Short {
    fn shorthands(&self) -> PyResult<Shorthands> {
        let Self { seed, no_nerf, predictions, near, far } = self;
        if let Some(seed) = seed.filter(|seed| i64::try_from(*seed).is_err()) {
            return Err(raise(format!("seed is {seed}; give 0 to 2^63 - 1")));
        }
        for (name, value) in [("near", near), ("far", far)] {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(raise(format!("{name} is {value}; give a positive number of metres")));
            }
        }
        let predictions = predictions.as_deref().map(Predictions::from_str).transpose();
        let predictions = predictions.map_err(|text| raise(format!("predictions: {text}")))?;
        Ok(Shorthands { seed: *seed, no_nerf: *no_nerf, predictions, near: *near, far: *far })
    }
}

#[pymethods]
impl Settings {
    /// `overrides` is TOML or, with `json`, a JSON object of tables; `origin` names it in errors. `short` has the settings with arguments
    /// of their own.
    #[new]
    #[pyo3(signature = (preset, overrides, json, origin, short))]
    fn new(preset: &str, overrides: &str, json: bool, origin: &str, short: Short) -> PyResult<Self> {
        let preset = named(preset)?;
        let table = match json {
            true => {
                let value: toml::Table = serde_json::from_str(overrides)
                    .map_err(|e| raise(format!("{origin}: {e}; give numbers, texts, lists and tables")))?;
                toml::to_string(&value).map_err(|e| raise(format!("{origin}: {e}")))?
            }
            false => overrides.to_owned(),
        };
        let mut config = Config::with_overrides(preset, &table, origin).map_err(raise)?;
        short.shorthands()?.apply(&mut config, Naming::Keywords).map_err(raise)?;
        Ok(Self { preset, config })
    }

    /// A preset with the values of a TOML file over it.
    #[staticmethod]
    #[pyo3(signature = (preset, path, short))]
    fn from_file(preset: &str, path: std::path::PathBuf, short: Short) -> PyResult<Self> {
        Self::new(preset, &read(&path)?, false, &path.display().to_string(), short)
    }

    /// Most photographs that are used with the first.
    #[getter]
    fn max_views(&self) -> usize {
        self.config.multi_view.max_views
    }

    /// All settings as TOML.
    fn to_toml(&self) -> PyResult<String> {
        self.config.to_toml().map_err(raise)
    }
}

/// The error bar of the results.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct ErrorBar(pub(crate) mde_cli::refiner::error_bar::ErrorBar);

#[pymethods]
impl ErrorBar {
    /// The probability of the interval, and the file of a calibration.
    #[new]
    #[pyo3(signature = (interval, calibration))]
    fn new(interval: Option<f64>, calibration: Option<std::path::PathBuf>) -> PyResult<Self> {
        if let Some(probability) = interval.filter(|probability| !(0.01..=0.99).contains(probability)) {
            return Err(raise(format!("interval is {probability}; give 0.01 to 0.99, such as 0.9")));
        }
        mde_cli::refiner::error_bar::ErrorBar::open(interval, calibration.as_deref()).map(Self).map_err(raise)
    }
}

fn read(path: &Path) -> PyResult<String> {
    std::fs::read_to_string(path)
        .map_err(|source| raise(mde_cli::error::Error::Io { path: path.to_owned(), source }))
}

fn named(name: &str) -> PyResult<Preset> {
    Preset::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(|| {
        let names: Vec<&str> = Preset::ALL.iter().map(|preset| preset.name()).collect();
        raise(format!("preset is {name:?}; give one of: {}", names.join(", ")))
    })
}
