//! How large errors are in sigmas on scenes whose depth is known, as a file.

use crate::{Config, Error, Preset, Result};
use mde_eval::conformal::{Conformal, held_out};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The version of the file's layout.
const FORMAT: u32 = 1;

/// The levels whose coverage on scenes that were left out is told.
const TOLD: [f64; 4] = [0.5, 0.68, 0.9, 0.95];

/// What `mde calibrate` writes: half widths of intervals in sigmas, and where they are from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Calibration {
    format: u32,
    settings: String,
    scenes: Vec<String>,
    half_widths: Vec<f64>,
    source: CalibrationSource,
    #[serde(default)]
    held_out: Vec<HeldOut>,
}

/// Where a calibration is from, in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct CalibrationSource {
    /// The preset or settings whose sigma it is of.
    pub method: String,
    /// The scenes' kind and size.
    pub data: String,
    /// Where the monocular depths came from.
    pub prior: String,
    /// How maps were brought to the truth's scale, and which depths counted.
    pub alignment: String,
}

/// What the intervals covered of each scene when only the others had a say.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct HeldOut {
    /// What the interval claims.
    pub probability: f64,
    /// Mean over scenes of the share of pixels that it held.
    pub mean: f64,
    /// The least of any scene.
    pub lowest: f64,
    /// The most.
    pub highest: f64,
}

impl Calibration {
    /// Learned from the scenes' quantiles of \\(|e| / \sigma\\) ([`Conformal::fit`]), for the sigma that `config` gives.
    ///
    /// # Errors
    /// What [`Conformal::fit`] refuses, or a configuration that has no place in TOML.
    pub fn learn(
        source: CalibrationSource,
        config: &Config,
        scenes: Vec<(String, Vec<f64>)>,
    ) -> Result<Self> {
        let (names, quantiles): (Vec<_>, Vec<_>) = scenes.into_iter().unzip();
        let table = Conformal::fit(&quantiles)?;
        let mut told = Vec::new();
        for probability in TOLD {
            if let Some(shares) = held_out(&quantiles, probability)? {
                let mean = shares.iter().sum::<f64>() / shares.len() as f64;
                let lowest = shares.iter().copied().fold(1.0, f64::min);
                let highest = shares.iter().copied().fold(0.0, f64::max);
                let [mean, lowest, highest] = [mean, lowest, highest].map(rounded);
                told.push(HeldOut { probability, mean, lowest, highest });
            }
        }
        Ok(Self {
            format: FORMAT,
            settings: fingerprint(config)?,
            scenes: names,
            half_widths: table.half_widths().iter().copied().map(rounded).collect(),
            source,
            held_out: told,
        })
    }

    /// The one that comes with the program: of the preset [`Preset::Default`] where a model can be asked again.
    ///
    /// # Errors
    /// None, unless the program was built from other files than its own.
    pub fn shipped() -> Result<Self> {
        Self::parse(include_str!("calibration/default.toml"), "the program's own calibration")
    }

    /// From the text of a file; `origin` names it in errors.
    ///
    /// # Errors
    /// [`Error::Config`] for text that is none, of another version, or with half widths that are no table.
    pub fn parse(text: &str, origin: &str) -> Result<Self> {
        let error = |reason: String| {
            let reason =
                reason.lines().map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join(" ");
            Error::Config {
                origin: origin.to_owned(),
                reason: format!("{reason}; `mde calibrate` makes one"),
            }
        };
        let read: Self = toml::from_str(text).map_err(|e| error(e.to_string()))?;
        if read.format != FORMAT {
            return Err(error(format!("calibration of format {}, where {FORMAT} is known", read.format)));
        }
        Conformal::from_half_widths(read.half_widths.clone()).map_err(|e| error(e.to_string()))?;
        Ok(read)
    }

    /// From a file.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read, else as [`parse`](Self::parse).
    pub fn from_file(path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// The text of its file.
    ///
    /// # Errors
    /// [`Error::Config`] where TOML refuses it.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self)
            .map_err(|e| Error::Config { origin: "calibration".into(), reason: e.to_string() })
    }

    /// The intervals.
    ///
    /// # Errors
    /// None: the table was checked when this was made.
    pub fn conformal(&self) -> Result<Conformal> {
        Ok(Conformal::from_half_widths(self.half_widths.clone())?)
    }

    /// Where it is from.
    pub fn source(&self) -> &CalibrationSource {
        &self.source
    }

    /// The scenes that it was learned from.
    pub fn scenes(&self) -> &[String] {
        &self.scenes
    }

    /// What the intervals covered of scenes that had no say; empty where there was only one scene.
    pub fn held_out(&self) -> &[HeldOut] {
        &self.held_out
    }

    /// Whether these settings are those whose sigma it was learned from.
    ///
    /// # Errors
    /// [`Error::Config`] for a configuration that has no place in TOML.
    pub fn is_of(&self, config: &Config) -> Result<bool> {
        Ok(self.settings == fingerprint(config)?)
    }
}

/// What sigma depends on: everything but the seed and the rule for disparities, which is the scene's.
fn fingerprint(config: &Config) -> Result<String> {
    let usual = Preset::Default.config();
    let config = Config { seed: 0, disparity: usual.disparity, ..config.clone() };
    Ok(format!("{:08x}", crc32fast::hash(config.to_toml()?.as_bytes())))
}

/// Six digits are more than any number of scenes can tell.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source() -> CalibrationSource {
        let text = |s: &str| s.to_owned();
        CalibrationSource { method: text("m"), data: text("d"), prior: text("p"), alignment: text("a") }
    }

    fn learned() -> Calibration {
        let scene = |by: f64| (0..=100).map(|k| by * f64::from(k) / 50.0).collect::<Vec<_>>();
        let scenes = vec![("one".to_owned(), scene(1.0)), ("two".to_owned(), scene(2.0))];
        Calibration::learn(source(), &Preset::Default.config(), scenes).unwrap()
    }

    #[test]
    fn a_file_says_what_was_learned() {
        let calibration = learned();
        let read = Calibration::parse(&calibration.to_toml().unwrap(), "f.toml").unwrap();
        assert_eq!(read, calibration);
        assert_eq!(read.scenes(), ["one", "two"]);
        // |z| is even on [0, 2] in one scene and on [0, 4] in the other: half of all is below 4/3.
        assert!((read.conformal().unwrap().half_width(0.5).unwrap() - 4.0 / 3.0).abs() < 1e-5);
        // From the wider scene alone, 90 % lie below 3.6, where all of the other lies: and the other way round 45 %.
        let nine = read.held_out().iter().find(|h| h.probability == 0.9).unwrap();
        assert!((nine.highest - 1.0).abs() < 1e-6 && (nine.lowest - 0.45).abs() < 1e-6, "{nine:?}");
    }

    #[test]
    fn it_knows_its_settings() {
        let (calibration, mut config) = (learned(), Preset::Default.config());
        config.seed = 5;
        assert!(calibration.is_of(&config).unwrap());
        config.sigma.spread = 3.0;
        assert!(!calibration.is_of(&config).unwrap());
    }

    #[test]
    fn the_shipped_one_is_of_the_default_settings() {
        let shipped = Calibration::shipped().unwrap();
        assert!(shipped.is_of(&Preset::Default.config()).unwrap(), "calibrate again: the settings changed");
        let factor = shipped.conformal().unwrap().factor(0.9).unwrap();
        assert!((0.8..1.25).contains(&factor), "{factor}");
    }

    #[test]
    fn what_is_no_calibration_is_refused_in_one_line() {
        let good = learned().to_toml().unwrap();
        for text in [
            "",
            "format = 1",
            "= =",
            &good.replace("format = 1", "format = 2"),
            &good.replace("half-widths = [0.0,", "half-widths = [-1.0,"),
            &good.replace("half-widths = [0.0,", "half-widths = ["),
            &good.replace("scenes", "scene"),
        ] {
            let message = Calibration::parse(text, "f.toml").unwrap_err().to_string();
            assert!(message.starts_with("f.toml: ") && message.contains("mde calibrate"), "{message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
