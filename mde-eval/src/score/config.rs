use crate::align::AlignmentRule;
use crate::metrics::ordinal::PairSampling;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Which pixels count and how they are scored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct ScoreConfig {
    /// True depths at or below do not count, metres.
    pub min_depth: f64,
    /// True depths at or above do not count, metres; aligned depths are clipped to it. 10: an indoor room.
    pub max_depth: f64,
    /// `[top, bottom, left, right]`, half open, in pixels: nothing outside counts. `[45, 471, 41, 601]` is Eigen's crop of
    /// NYU's 640 x 480.
    pub crop: Option<[usize; 4]>,
    /// How the prediction is brought to the truth's scale.
    pub alignment: AlignmentRule,
    /// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
    pub edge_thresholds: Vec<f64>,
    /// Tolerances of the edge scores, pixels.
    pub edge_tolerances: Vec<u32>,
    /// Thresholds of the truth for the edges that are [matched one to one](crate::metrics::bsds), metres of Sobel gradient (gain 8).
    pub boundary_thresholds: Vec<f64>,
    /// The truth's threshold between on-edge and off-edge sharpness, metres of Sobel gradient (gain 8).
    pub band_threshold: f64,
    /// How far from a true edge a pixel is still on it, pixels.
    pub band: f64,
    /// Pairs for the depth-discontinuity disagreement.
    pub pairs: PairSampling,
    /// Central intervals whose coverage is reported, in 0 to 1.
    pub levels: Vec<f64>,
    /// Bins of the ENCE.
    pub ence_bins: usize,
    /// Percentile bins of the binned Spearman correlation.
    pub spearman_bins: usize,
}

impl Default for ScoreConfig {
    fn default() -> Self {
        Self {
            min_depth: 1e-3,
            max_depth: 10.0,
            crop: None,
            alignment: AlignmentRule::Median,
            edge_thresholds: vec![0.25, 0.5, 1.0],
            edge_tolerances: vec![0, 1, 2],
            boundary_thresholds: vec![0.25, 0.5],
            band_threshold: 0.5,
            band: 3.0,
            pairs: PairSampling::discontinuities(),
            levels: vec![0.5, 0.68, 0.9, 0.95],
            ence_bins: 20,
            spearman_bins: 100,
        }
    }
}

impl ScoreConfig {
    /// For sensors that are reliable up to 8 m (SUN RGB-D).
    #[must_use]
    pub fn sunrgbd() -> Self {
        Self { max_depth: 8.0, ..Self::default() }
    }

    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field at fault.
    pub fn validate(&self) -> Result<()> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        check(
            "min-depth",
            self.min_depth,
            self.min_depth >= 0.0 && self.min_depth.is_finite(),
            "use a finite number from 0",
        )?;
        let ordered = self.max_depth > self.min_depth && positive(self.max_depth);
        check("max-depth", self.max_depth, ordered, "use a finite number above min-depth")?;
        if let Some([top, bottom, left, right]) = self.crop {
            let value = format!("[{top}, {bottom}, {left}, {right}]");
            check(
                "crop",
                value,
                top < bottom && left < right,
                "use [top, bottom, left, right] with top < bottom and left < right",
            )?;
        }
        for &threshold in &self.edge_thresholds {
            check("edge-thresholds", threshold, positive(threshold), "use positive finite metres")?;
        }
        for &threshold in &self.boundary_thresholds {
            check("boundary-thresholds", threshold, positive(threshold), "use positive finite metres")?;
        }
        for &tolerance in &self.edge_tolerances {
            check("edge-tolerances", tolerance, tolerance <= 64, "use at most 64 pixels")?;
        }
        check(
            "band-threshold",
            self.band_threshold,
            positive(self.band_threshold),
            "use positive finite metres",
        )?;
        check("band", self.band, self.band >= 0.0, "use 0 pixels or more")?;
        for &level in &self.levels {
            check("levels", level, level > 0.0 && level < 1.0, "use probabilities between 0 and 1")?;
        }
        check("ence-bins", self.ence_bins, self.ence_bins > 0, "use at least 1")?;
        check("spearman-bins", self.spearman_bins, self.spearman_bins > 1, "use at least 2")?;
        self.pairs.validate()
    }
}

fn check(field: &'static str, value: impl ToString, sound: bool, remedy: &'static str) -> Result<()> {
    if sound { Ok(()) } else { Err(Error::Config { field, value: value.to_string(), remedy }) }
}
