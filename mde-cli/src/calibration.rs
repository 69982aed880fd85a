//! How large errors are in sigmas on scenes whose depth is known, as a file.

use crate::config::SigmaConfig;
use crate::{Config, Error, Result};
use mde_eval::conformal::{Conformal, held_out};
use mde_prior::AugmentationConfig;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The version of the file's layout.
const FORMAT: u32 = 1;

/// What it may make of sigma: beyond, variances would be no floats.
const FACTORS: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

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
    /// The probability at which a calibrated sigma's normal interval is right.
    pub const AT: f64 = 0.9;

    /// Learned from the scenes' quantiles of \\(|e| / \sigma\\) ([`Conformal::fit`]), for the sigma that `config` gives with a prior that
    /// accepts new images, or does not.
    ///
    /// # Errors
    /// What [`Conformal::fit`] refuses, half widths as [`parse`](Self::parse) refuses them, or a configuration that has no place in
    /// TOML.
    pub fn learn(
        source: CalibrationSource,
        config: &Config,
        accepts_new_images: bool,
        scenes: Vec<(String, Vec<f64>)>,
    ) -> Result<Self> {
        let (names, quantiles): (Vec<_>, Vec<_>) = scenes.into_iter().unzip();
        let table = Conformal::fit(&quantiles)?;
        usable(&table).map_err(|reason| Error::Config { origin: "the scenes' errors".into(), reason })?;
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
            settings: fingerprint(config, accepts_new_images)?,
            scenes: names,
            half_widths: table.half_widths().iter().copied().map(rounded).collect(),
            source,
            held_out: told,
        })
    }

    /// The one that comes with the program: of the preset [`Preset::Default`](crate::Preset::Default) with a model.
    ///
    /// # Errors
    /// None, unless the program was built from other files than its own.
    pub fn shipped() -> Result<Self> {
        Self::parse(include_str!("calibration/default.toml"), "the program's own calibration")
    }

    /// From the text of a file; `origin` names it in errors.
    ///
    /// # Errors
    /// [`Error::Config`] for text that is none, of another version, or with half widths that are no table or make sigma less than
    /// a millionth or more than a million times as large.
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
        Conformal::from_half_widths(read.half_widths.clone())
            .map_err(|e| e.to_string())
            .and_then(|table| usable(&table))
            .map_err(error)?;
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

    /// Whether its sigma is what these settings give with a prior that accepts new images, or does not.
    ///
    /// # Errors
    /// [`Error::Config`] for a configuration that has no place in TOML.
    pub fn is_of(&self, config: &Config, accepts_new_images: bool) -> Result<bool> {
        Ok(self.settings == fingerprint(config, accepts_new_images)?)
    }
}

/// Refuses a table that leaves no sigma.
fn usable(table: &Conformal) -> Result<(), String> {
    let factor = table.factor(Calibration::AT).map_err(|e| e.to_string())?;
    if FACTORS.contains(&factor) {
        return Ok(());
    }
    Err(format!("half-widths make sigma {factor:e} times as large; from 1e-6 to 1e6 times is usable"))
}

/// What sigma depends on.
#[derive(Serialize)]
struct Decisive<'c> {
    /// Where the model is augmented.
    augmentation: Option<(&'c AugmentationConfig, &'c SigmaConfig)>,
    /// With a field everything counts but the seed and the rule for disparities, which is the scene's; without one only this.
    common_error: f64,
    field: Option<Config>,
}

fn fingerprint(config: &Config, accepts_new_images: bool) -> Result<String> {
    let augmented = accepts_new_images && config.augmentation.is_active();
    let Config { refinement, augmentation, sigma, .. } = config;
    let usual = Config::default();
    let decisive = Decisive {
        augmentation: augmented.then_some((augmentation, sigma)),
        common_error: config.fusion.common_error,
        field: refinement.fits_a_field(augmented).then(|| Config {
            seed: 0,
            disparity: usual.disparity,
            augmentation: usual.augmentation,
            sigma: usual.sigma,
            ..config.clone()
        }),
    };
    let text = serde_json::to_string(&decisive)
        .map_err(|e| Error::Config { origin: "settings".into(), reason: e.to_string() })?;
    Ok(format!("{:08x}", crc32fast::hash(text.as_bytes())))
}

/// Six digits are more than any number of scenes can tell.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    fn source() -> CalibrationSource {
        let text = |s: &str| s.to_owned();
        CalibrationSource { method: text("m"), data: text("d"), prior: text("p"), alignment: text("a") }
    }

    fn learned() -> Calibration {
        let scene = |by: f64| (0..=100).map(|k| by * f64::from(k) / 50.0).collect::<Vec<_>>();
        let scenes = vec![("one".to_owned(), scene(1.0)), ("two".to_owned(), scene(2.0))];
        Calibration::learn(source(), &Preset::Default.config(), true, scenes).unwrap()
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
        let (calibration, usual) = (learned(), Preset::Default.config());
        let is_of = |change: &dyn Fn(&mut Config), accepts_new_images| {
            let mut config = usual.clone();
            change(&mut config);
            calibration.is_of(&config, accepts_new_images).unwrap()
        };
        assert!(is_of(&|c| c.seed = 5, true));
        assert!(!is_of(&|_| (), false), "a prior that is not augmented has another sigma");
        // Without a field its settings play no part.
        assert!(is_of(&|c| c.refinement.iterations = 0, true));
        assert!(is_of(&|c| c.nerf.train.steps = 7, true));
        assert!(!is_of(&|c| c.refinement.field = crate::config::FieldUse::Always, true));
        assert!(!is_of(&|c| c.sigma.spread = 3.0, true));
        assert!(!is_of(&|c| c.augmentation.levels.truncate(1), true));
        assert!(!is_of(&|c| c.fusion.common_error = 0.1, true));
    }

    #[test]
    fn the_shipped_one_is_of_the_default_settings() {
        let shipped = Calibration::shipped().unwrap();
        assert!(
            shipped.is_of(&Preset::Default.config(), true).unwrap(),
            "calibrate again: the settings changed"
        );
        let factor = shipped.conformal().unwrap().factor(0.9).unwrap();
        assert!((0.8..1.25).contains(&factor), "{factor}");
    }

    /// Sigmas of 0 would be certain, and infinite ones missing.
    #[test]
    fn a_factor_that_leaves_no_sigma_is_refused() {
        for (by, usable) in [(1.0, true), (1e-9, false), (1e9, false), (1e300, false)] {
            let mut calibration = learned();
            calibration.half_widths.iter_mut().for_each(|width| *width *= by);
            let read = Calibration::parse(&calibration.to_toml().unwrap(), "f.toml");
            assert_eq!(read.is_ok(), usable, "{by}: {read:?}");
        }
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
