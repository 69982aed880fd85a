//! The error bar of a result: sigma by a calibration, and an interval.

use crate::config::{Config, Preset};
use crate::error::Result;
use crate::prior::{PriorForm, PriorOrigin};
use crate::refiner::calibration::{fingerprint, read, shipped};
use crate::reports::Refinement;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::calibration::{Calibration, Mismatch};
use mde_uncertainty::pooled::Tails;
use ndarray::{Array2, Zip};
use serde::Serialize;
use std::path::Path;

/// The requested error bar.
#[derive(Debug, Clone, Default)]
pub struct ErrorBar {
    probability: Option<f64>,
    given: Option<(String, Calibration)>,
}

/// The stated error bar, for the record.
#[derive(Debug, Serialize)]
pub struct Stated {
    /// Factor applied to sigma.
    pub factor: f64,
    /// The interval, where one is requested.
    pub interval: Option<Interval>,
    /// Error of the scale of the whole map, which sigma does not contain; nothing where it is not known.
    pub scale: Option<ScaleError>,
    /// Source of the error that all predictions share, `fusion.common-error`, for a model; nothing where it is assumed.
    pub common_by: Option<String>,
    /// That error where it is FastDepth's, assumed of another prior: as a fraction of the depth.
    pub common_assumed: Option<f64>,
    /// Warnings about it, such as a calibration of another network.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

/// Error of the scale of the whole map.
#[derive(Debug, Serialize)]
pub struct ScaleError {
    /// Standard deviation, as a fraction of the depth.
    pub relative: f64,
    /// Its source.
    pub by: String,
}

/// An interval about the depth of each pixel.
#[derive(Debug, Serialize)]
pub struct Interval {
    /// The probability with which it is meant to contain the true depth.
    pub probability: f64,
    /// In sigmas of the result.
    pub half_width: f64,
    /// Source of the half width.
    pub by: String,
}

impl ErrorBar {
    /// An interval of that probability, and a calibration from a file; either may be missing.
    ///
    /// # Errors
    /// Those of [`read`].
    pub fn open(probability: Option<f64>, calibration: Option<&Path>) -> Result<Self> {
        let named = |path: &Path| -> Result<_> { Ok((path.display().to_string(), read(path)?)) };
        Ok(Self { probability, given: calibration.map(named).transpose()? })
    }

    /// What results depend on: the probability, and the calibration by its content.
    pub(crate) fn identity(&self) -> Result<(Option<f64>, Option<String>)> {
        let content = |(_, calibration): &(String, Calibration)| calibration.to_toml();
        Ok((self.probability, self.given.as_ref().map(content).transpose()?))
    }

    /// The probability of the interval, where one is requested.
    pub fn probability(&self) -> Option<f64> {
        self.probability
    }

    /// Scales sigma, its parts and the reported common error, where a calibration was given, and finds the interval. `several`: the
    /// depth is that of several photographs; `scaled`: known depths give the scale.
    ///
    /// # Errors
    /// [`Error::Depth`](crate::error::Error::Depth) for a calibration without scenes, or a probability out of range.
    pub fn apply(
        &self,
        refinement: &mut Refinement,
        config: &Config,
        prior: &PriorOrigin,
        several: bool,
        scaled: bool,
    ) -> Result<Stated> {
        let run = fingerprint(config, prior.predicts(), several, prior.model_hash.clone())?;
        let mut warnings = Vec::new();
        let mut factor = 1.0;
        if let Some((name, calibration)) = &self.given {
            let source = &calibration.source;
            let other = match calibration.mismatch(&run) {
                None if prior.form == PriorForm::Map => Some(format!(
                    "a map from a file does not name its network; use the calibration for maps of the network that it was estimated with ({})",
                    source.prior
                )),
                None => None,
                Some(mismatch) => {
                    let other = match mismatch {
                        Mismatch::Settings => "other settings, or another kind of prior",
                        Mismatch::Model => "another depth model",
                    };
                    Some(format!(
                        "estimated with {other} ({}); calibrate with the settings and the model of this run",
                        source.method
                    ))
                }
            };
            warnings.extend(other.map(|other| format!("{{calibration}} {name}: {other}")));
            factor = calibration.intervals()?.factor(Calibration::AT)?;
            let squared = (factor * factor) as f32;
            let depth = std::mem::replace(&mut refinement.depth, GaussianDepth::missing(0, 0));
            refinement.depth =
                depth.map(|mean, variance| (mean, (variance * squared).max(f32::MIN_POSITIVE)));
            for part in &mut refinement.components {
                part.sigma.mapv_inplace(|sigma| factor as f32 * sigma);
            }
            let common = refinement.augmentation.common_error.unwrap_or(config.fusion.common_error);
            refinement.augmentation.common_error = Some(factor * common);
        }
        let shipped = shipped()?;
        let mismatch = shipped.mismatch(&run);
        // The calibration of the interval with a name for it: the given one, else the program's own where it fits this run.
        let fitting = match (&self.given, mismatch) {
            (Some((name, calibration)), _) => Some((name.clone(), calibration)),
            (None, None) => {
                let (scenes, source) = (shipped.scenes.len(), &shipped.source);
                Some((format!("{scenes} scenes of {} with {}", source.data, source.prior), &shipped))
            }
            (None, Some(_)) => None,
        };
        let common_by = fitting.as_ref().map(|(by, _)| by.clone());
        let usual = Preset::Default.config().fusion.common_error;
        let states = refinement.components.iter().any(|part| part.name == "common");
        let common_assumed =
            Some(usual).filter(|usual| states && common_by.is_none() && config.fusion.common_error == *usual);
        let of_scale = |(by, calibration): &(String, &Calibration)| {
            Some(ScaleError { relative: calibration.scale_error?, by: by.clone() })
        };
        let scale = fitting.as_ref().filter(|_| !scaled).and_then(of_scale);
        let mut stated = Stated { factor, interval: None, scale, common_by, common_assumed, warnings };
        let Some(probability) = self.probability else { return Ok(stated) };
        let (half_width, by) = match fitting {
            Some((by, calibration)) => (calibration.intervals()?.half_width(probability)? / factor, by),
            None if several => {
                (Tails::Heavy.half_width(probability)?, "Student's t of two degrees".to_owned())
            }
            None => {
                let of =
                    if mismatch == Some(Mismatch::Model) { "this depth model" } else { "these settings" };
                stated.warnings.push(format!(
                    "{{interval}}: no calibration for {of}, so the interval assumes a normal distribution; calibrate to estimate one"
                ));
                (Tails::Normal.half_width(probability)?, "normal distribution".to_owned())
            }
        };
        if self.given.is_none() && !prior.kind.is_depth() && !scaled {
            stated.warnings.push(
                "{interval}: the depth range assumed for disparities has an error that sigma does not include; calibrate with {alignment} none to \
                 include it"
                    .to_owned(),
            );
        }
        stated.interval = Some(Interval { probability, half_width, by });
        Ok(stated)
    }
}

impl Interval {
    /// Its lower and upper ends; 0 and infinity where there is no depth, and nowhere else: an end below 0 is the least positive number.
    pub fn bounds(&self, depth: &GaussianDepth) -> [Array2<f32>; 2] {
        let sigma = depth.sigma();
        let end = |side: f32, missing: f32| {
            Zip::from(depth.mean()).and(&sigma).map_collect(|&depth, &sigma| match sigma.is_finite() {
                true => (depth + side * self.half_width as f32 * sigma).clamp(f32::MIN_POSITIVE, f32::MAX),
                false => missing,
            })
        };
        [end(-1.0, 0.0), end(1.0, f32::INFINITY)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn an_interval_is_about_the_depth_and_only_the_missing_are_zero() {
        let depth = GaussianDepth::new(array![[2.0, 1.0, 0.0]], array![[0.25, 4.0, f32::INFINITY]]).unwrap();
        let interval = Interval { probability: 0.9, half_width: 2.0, by: String::new() };
        let [lower, upper] = interval.bounds(&depth);
        assert_eq!(lower, array![[1.0, f32::MIN_POSITIVE, 0.0]]);
        assert_eq!(upper, array![[3.0, 5.0, f32::INFINITY]]);
    }
}
