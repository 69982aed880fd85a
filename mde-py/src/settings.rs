//! Settings of a run: a preset and what overrides it.

use crate::error::raise;
use mde_cli::{Config, Preset};
use pyo3::prelude::*;
use std::path::Path;
use std::time::Duration;

/// The preset and the configuration of a run.
#[pyclass(frozen, module = "mdenerf._mdenerf")]
pub(crate) struct Settings {
    pub(crate) preset: Preset,
    pub(crate) config: Config,
    pub(crate) budget: Option<Duration>,
}

#[pymethods]
impl Settings {
    /// `overrides` is TOML or, with `json`, a JSON object of tables; `origin` names it in errors.
    #[new]
    #[pyo3(signature = (preset, overrides, json, origin, seed, budget))]
    fn new(
        preset: &str,
        overrides: &str,
        json: bool,
        origin: &str,
        seed: Option<u64>,
        budget: Option<f64>,
    ) -> PyResult<Self> {
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
        if let Some(seed) = seed {
            if i64::try_from(seed).is_err() {
                return Err(raise(format!("seed is {seed}; give 0 to 2^63 - 1")));
            }
            config.seed = seed;
        }
        let budget = match budget {
            Some(seconds) if !(seconds > 0.0 && seconds.is_finite()) => {
                return Err(raise(format!("budget is {seconds}; give a positive number of seconds")));
            }
            seconds => seconds.map(Duration::from_secs_f64),
        };
        Ok(Self { preset, config, budget })
    }

    /// A preset with the values of a TOML file over it.
    #[staticmethod]
    #[pyo3(signature = (preset, path, seed, budget))]
    fn from_file(
        preset: &str,
        path: std::path::PathBuf,
        seed: Option<u64>,
        budget: Option<f64>,
    ) -> PyResult<Self> {
        Self::new(preset, &read(&path)?, false, &path.display().to_string(), seed, budget)
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
pub(crate) struct ErrorBar(pub(crate) mde_cli::results::ErrorBar);

#[pymethods]
impl ErrorBar {
    /// The probability of the interval, and the file of a calibration.
    #[new]
    #[pyo3(signature = (interval, calibration))]
    fn new(interval: Option<f64>, calibration: Option<std::path::PathBuf>) -> PyResult<Self> {
        if let Some(probability) = interval.filter(|probability| !(0.01..=0.99).contains(probability)) {
            return Err(raise(format!("interval is {probability}; give 0.01 to 0.99, such as 0.9")));
        }
        mde_cli::results::ErrorBar::open(interval, calibration.as_deref()).map(Self).map_err(raise)
    }
}

fn read(path: &Path) -> PyResult<String> {
    std::fs::read_to_string(path)
        .map_err(|source| raise(mde_cli::Error::Io { path: path.to_owned(), source }))
}

fn named(name: &str) -> PyResult<Preset> {
    Preset::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(|| {
        let names: Vec<&str> = Preset::ALL.iter().map(|preset| preset.name()).collect();
        raise(format!("preset is {name:?}; give one of: {}", names.join(", ")))
    })
}
