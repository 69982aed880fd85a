//! The file of a calibration: [pooled intervals](crate::pooled) with the settings, the model and the scenes that they are of.

use crate::pooled::{PooledIntervals, held_out};
use crate::{Error, OutOfRange, Result};
use serde::{Deserialize, Serialize};

/// Version of the file's layout.
const FORMAT: u32 = 2;
/// Most characters of a line that an error quotes.
const LONGEST_LINE: usize = 120;
/// Factors on sigma whose squares leave variances that are floats.
const FACTORS: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// Probabilities whose coverage on scenes that were left out is recorded.
const HELD_OUT: [f64; 4] = [0.5, 0.68, 0.9, 0.95];

/// Half widths of intervals in sigmas, and what they were estimated from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Calibration {
    format: u32,
    settings: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<String>,
    /// Names of the scenes that it was estimated from.
    pub scenes: Vec<String>,
    half_widths: Vec<f64>,
    /// Standard deviation of the maps' scale as a fraction of the depth, where maps had a scale and were aligned by a factor. Neither
    /// sigma nor the intervals contain it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_error: Option<f64>,
    /// Where it is from.
    pub source: CalibrationSource,
    /// Coverage of each scene by the others' intervals; empty for a single scene.
    #[serde(default)]
    pub held_out: Vec<HeldOut>,
}

/// Where a calibration is from, in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct CalibrationSource {
    /// The preset, or the file of the settings.
    pub method: String,
    /// Kind and size of the scenes.
    pub data: String,
    /// Where the monocular depths are from.
    pub prior: String,
    /// How maps were aligned with the true depth, and which depths counted.
    pub alignment: String,
}

/// Coverage of scenes by the intervals of all other scenes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct HeldOut {
    /// Stated probability of the interval.
    pub probability: f64,
    /// Mean over scenes of the share of pixels inside it.
    pub mean: f64,
    /// The lowest share of a scene.
    pub lowest: f64,
    /// The highest share of a scene.
    pub highest: f64,
}

/// Identifies what the sigma of a run depends on, as the caller spells it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fingerprint {
    /// Of the settings.
    pub settings: String,
    /// Of the depth model's file; `None` for depth maps without a model.
    pub model: Option<String>,
}

/// How a run differs from those that a calibration was estimated from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mismatch {
    /// Other settings.
    Settings,
    /// The same settings with another depth model.
    Model,
}

impl Calibration {
    /// The probability at which the normal interval of a calibrated sigma has the table's half width.
    pub const AT: f64 = 0.9;

    /// Estimated from `scenes`, each a name and the quantiles of \\(|e| / \sigma\\) ([`PooledIntervals::fit`]).
    ///
    /// # Errors
    /// As [`PooledIntervals::fit`]; [`Error::Config`] for a [factor](PooledIntervals::factor) outside of \\(10^{-6}\\) to \\(10^6\\).
    pub fn fit(
        source: CalibrationSource,
        fingerprint: Fingerprint,
        scenes: Vec<(String, Vec<f64>)>,
    ) -> Result<Self> {
        let (names, quantiles): (Vec<_>, Vec<_>) = scenes.into_iter().unzip();
        let table = PooledIntervals::fit(&quantiles)?;
        usable(&table)?;
        let mut coverages = Vec::new();
        for probability in HELD_OUT {
            if let Some(shares) = held_out(&quantiles, probability)? {
                let mean = rounded(shares.iter().sum::<f64>() / shares.len() as f64);
                let lowest = rounded(shares.iter().copied().fold(1.0, f64::min));
                let highest = rounded(shares.iter().copied().fold(0.0, f64::max));
                coverages.push(HeldOut { probability, mean, lowest, highest });
            }
        }
        Ok(Self {
            format: FORMAT,
            settings: fingerprint.settings,
            model: fingerprint.model,
            scenes: names,
            half_widths: table.half_widths.into_iter().map(rounded).collect(),
            scale_error: None,
            source,
            held_out: coverages,
        })
    }

    /// With the error of each map's scale, the part that alignment takes out of the errors: the root mean square of \\(\ln s\\) over the
    /// scenes, with \\(s\\) the factor that brings a map to the truth. None without scenes, or with a factor that is not positive.
    #[must_use]
    pub fn with_scales(mut self, scales: &[f64]) -> Self {
        let mean = scales.iter().map(|s| s.ln().powi(2)).sum::<f64>() / scales.len() as f64;
        self.scale_error = mean.is_finite().then(|| rounded(mean.sqrt()));
        self
    }

    /// From the text of a file; `origin` names it in errors.
    ///
    /// # Errors
    /// [`Error::Calibration`] for text that is no calibration, has another version, or whose half widths are not those of a table
    /// with a usable factor.
    pub fn parse(text: &str, origin: &str) -> Result<Self> {
        let error = |reason: String| {
            let lines = reason.lines().map(str::trim).filter(|line| !line.is_empty());
            // TOML quotes the line at fault, which may be a table of many numbers.
            let short = |line: &str| match line.contains('|') {
                true => line.chars().take(LONGEST_LINE).collect(),
                false => line.to_owned(),
            };
            let reason = lines.map(short).collect::<Vec<String>>().join(" ");
            Error::Calibration { origin: origin.to_owned(), reason }
        };
        /// So that a file of another version is refused for its version.
        #[derive(Deserialize)]
        struct Version {
            format: u32,
        }
        let Version { format } = toml::from_str(text).map_err(|e| error(e.to_string()))?;
        if format != FORMAT {
            return Err(error(format!("format is {format}, which must be {FORMAT}")));
        }
        let read: Self = toml::from_str(text).map_err(|e| error(e.to_string()))?;
        if read.scale_error.is_some_and(|e| !(0.0..=10.0).contains(&e)) {
            let reason = "scale-error is no standard deviation of a logarithm; give 0 to 10";
            return Err(error(reason.to_owned()));
        }
        PooledIntervals::from_half_widths(read.half_widths.clone())
            .and_then(|table| usable(&table))
            .map_err(|e| error(e.to_string()))?;
        Ok(read)
    }

    /// The text of its file.
    ///
    /// # Errors
    /// [`Error::Calibration`] where TOML refuses it.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self)
            .map_err(|e| Error::Calibration { origin: "calibration".to_owned(), reason: e.to_string() })
    }

    /// The intervals.
    ///
    /// # Errors
    /// None: the table was checked when this was made.
    pub fn intervals(&self) -> Result<PooledIntervals> {
        PooledIntervals::from_half_widths(self.half_widths.clone())
    }

    /// How a run differs from those that this was estimated from, or `None` where it does not.
    pub fn mismatch(&self, run: &Fingerprint) -> Option<Mismatch> {
        if self.settings != run.settings {
            return Some(Mismatch::Settings);
        }
        (self.model != run.model).then_some(Mismatch::Model)
    }
}

/// Refuses a table whose factor leaves no sigma.
fn usable(table: &PooledIntervals) -> Result<()> {
    let factor = table.factor(Calibration::AT)?;
    let value = format!("a table that multiplies sigma by {factor:e}");
    let remedy = "give one that multiplies it by 1e-6 to 1e6";
    Ok(OutOfRange::check(FACTORS.contains(&factor), "half-widths", &value, remedy)?)
}

/// Six digits are more than any number of scenes determines.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted() -> Calibration {
        let text = |s: &str| s.to_owned();
        let source =
            CalibrationSource { method: text("m"), data: text("d"), prior: text("p"), alignment: text("a") };
        let scene = |by: f64| (0..=100).map(|k| by * f64::from(k) / 50.0).collect::<Vec<_>>();
        let scenes = vec![("one".to_owned(), scene(1.0)), ("two".to_owned(), scene(2.0))];
        let fingerprint = Fingerprint { settings: text("s"), model: Some(text("m")) };
        Calibration::fit(source, fingerprint, scenes).unwrap()
    }

    #[test]
    fn a_file_holds_what_was_estimated() {
        let calibration = fitted();
        let read = Calibration::parse(&calibration.to_toml().unwrap(), "f.toml").unwrap();
        assert_eq!(read, calibration);
        assert_eq!(read.scenes, ["one", "two"]);
        // |z| is uniform on [0, 2] in one scene and on [0, 4] in the other: half of all is below 4/3.
        assert!((read.intervals().unwrap().half_width(0.5).unwrap() - 4.0 / 3.0).abs() < 1e-5);
        // 90 % of the second scene lie below 3.6, as does all of the first; 90 % of the first below 1.8, as does 45 % of the second.
        let nine = read.held_out.iter().find(|h| h.probability == 0.9).unwrap();
        assert!((nine.highest - 1.0).abs() < 1e-6 && (nine.lowest - 0.45).abs() < 1e-6, "{nine:?}");
    }

    #[test]
    fn the_scale_s_error_is_the_root_mean_square_of_its_logarithm() {
        assert_eq!(fitted().scale_error, None);
        let by = |factor: f64| fitted().with_scales(&[factor, 1.0 / factor]).scale_error;
        assert!((by(1.2).unwrap() - 1.2_f64.ln()).abs() < 1e-6 && by(1.0) == Some(0.0));
        assert_eq!([by(0.0), by(-1.0), by(f64::NAN), fitted().with_scales(&[]).scale_error], [None; 4]);
        let kept = fitted().with_scales(&[1.5]);
        assert_eq!(Calibration::parse(&kept.to_toml().unwrap(), "f.toml").unwrap(), kept);
        let wrong = kept.to_toml().unwrap().replace("scale-error = 0", "scale-error = -0");
        assert!(Calibration::parse(&wrong, "f.toml").unwrap_err().to_string().contains("scale-error"));
    }

    #[test]
    fn another_model_is_not_another_setting() {
        let calibration = fitted();
        for (settings, model, expected) in [
            ("s", Some("m"), None),
            ("s", Some("n"), Some(Mismatch::Model)),
            ("s", None, Some(Mismatch::Model)),
            ("t", None, Some(Mismatch::Settings)),
        ] {
            let run = Fingerprint { settings: settings.to_owned(), model: model.map(str::to_owned) };
            assert_eq!(calibration.mismatch(&run), expected);
        }
    }

    /// Sigmas of 0 would be exact, and infinite ones missing.
    #[test]
    fn a_factor_that_leaves_no_sigma_is_refused() {
        for (by, usable) in [(1.0, true), (1e-9, false), (1e9, false), (1e300, false)] {
            let mut calibration = fitted();
            calibration.half_widths.iter_mut().for_each(|width| *width *= by);
            let read = Calibration::parse(&calibration.to_toml().unwrap(), "f.toml");
            assert_eq!(read.is_ok(), usable, "{by}: {read:?}");
        }
    }

    #[test]
    fn a_text_that_is_no_calibration_is_refused_in_one_line() {
        let good = fitted().to_toml().unwrap();
        for (text, reason) in [
            ("", "missing field `format`"),
            ("format = 2", "missing field"),
            ("= =", "TOML parse error"),
            (&*good.replace("format = 2", "format = 1"), "format is 1, which must be 2"),
            (&*good.replace("half-widths = [0.0,", "half-widths = [-1.0,"), "half-widths is"),
            (&*good.replace("half-widths = [0.0,", "half-widths = ["), "a list of 99"),
            (&*good.replace("scenes", "scene"), "unknown field `scene`"),
        ] {
            let message = Calibration::parse(text, "f.toml").unwrap_err().to_string();
            assert!(message.starts_with("f.toml: ") && message.contains(reason), "{message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
