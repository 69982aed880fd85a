use crate::align::AlignmentRule;
use crate::error::check;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Which pixels count and how a map is brought to the truth's scale.
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
}

impl Default for ScoreConfig {
    fn default() -> Self {
        Self { min_depth: 1e-3, max_depth: 10.0, crop: None, alignment: AlignmentRule::Median }
    }
}

impl ScoreConfig {
    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field at fault.
    pub fn validate(&self) -> Result<()> {
        let (min, max) = (self.min_depth, self.max_depth);
        check([
            ("min-depth", min, min >= 0.0 && min.is_finite(), "use a finite number from 0"),
            ("max-depth", max, max > min && max.is_finite(), "use a finite number above min-depth"),
        ])?;
        match self.crop {
            Some(crop @ [top, bottom, left, right]) if top >= bottom || left >= right => Err(Error::Config {
                field: "crop",
                value: format!("{crop:?}"),
                remedy: "use [top, bottom, left, right] with top < bottom and left < right",
            }),
            _ => Ok(()),
        }
    }
}
