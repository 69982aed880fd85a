//! All metrics of one map against the truth, as serialisable values.

mod map;
mod metric;
mod sigma;

pub use map::TruthCache;
pub use metric::{Better, Group, METRICS, Metric};
pub use sigma::UncertaintyCurves;

use crate::align::{Alignment, AlignmentRule};
use crate::error::check;
use crate::raster::{Map, Mask, same_shape};
use crate::{Error, Result};
use map::DepthMap;
use mde_uncertainty::OutOfRange;
use metric::Of;
use ndarray::{Array2, Zip};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::{Deserialize, Serialize};
use sigma::SigmaMap;
use std::collections::BTreeMap;

/// Which pixels count and how a map is brought to the truth's scale.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct ScoreConfig {
    /// True depths at or below do not count, metres.
    pub min_depth: f64,
    /// True depths at or above do not count, metres; aligned depths are clipped to it. 10: an indoor room.
    pub max_depth: f64,
    /// `[top, bottom, left, right]`, half open, in pixels: nothing outside counts. `[45, 471, 41, 601]` is Eigen's crop of NYU's 640 x 480.
    pub crop: Option<[usize; 4]>,
    /// How the prediction is brought to the truth's scale.
    pub alignment: AlignmentRule,
}

impl Default for ScoreConfig {
    fn default() -> Self {
        Self { min_depth: 1e-3, max_depth: 10.0, crop: None, alignment: AlignmentRule::MedianRatio }
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
            Some(crop @ [top, bottom, left, right]) if top >= bottom || left >= right => {
                let remedy = "use [top, bottom, left, right] with top < bottom and left < right";
                Err(OutOfRange::new("crop", format!("{crop:?}"), remedy).into())
            }
            _ => Ok(()),
        }
    }
}

/// A prediction with or without its uncertainty, the truth, and the pixels that count.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Predicted depth `[height, width]`, any unit; not positive or not finite means missing.
    pub prediction: Map<'a>,
    /// Predicted standard deviation of the depth `[height, width]`, in the prediction's unit. A pixel where it is not
    /// positive and finite has no uncertainty and is left out of those scores.
    pub sigma: Option<Map<'a>>,
    /// True depth `[height, width]` in metres; not positive or not finite means missing.
    pub truth: Map<'a>,
    /// Pixels that may count `[height, width]`; all without it.
    pub mask: Option<Mask<'a>>,
    /// What other predictions of the truth share.
    pub cache: Option<&'a TruthCache>,
}

impl<'a> Subject<'a> {
    /// A prediction and its truth, all pixels.
    pub fn new(prediction: Map<'a>, truth: Map<'a>) -> Self {
        Self { prediction, sigma: None, truth, mask: None, cache: None }
    }

    /// With the prediction's standard deviation.
    #[must_use]
    pub fn with_sigma(self, sigma: Map<'a>) -> Self {
        Self { sigma: Some(sigma), ..self }
    }

    /// The pixels that count, `[height, width]`:
    /// \\(m = \\{g_{min} < g < g_{max}\\} \cap \\{p > 0,\ p\ \text{finite}\\}\\), within the mask and the crop.
    ///
    /// # Errors
    /// [`Error::Shape`] where the maps differ, [`Error::Empty`] where no pixel is left.
    pub fn pixels(&self, config: &ScoreConfig) -> Result<Array2<bool>> {
        let shape = self.truth.dim();
        same_shape("the prediction", self.prediction.dim(), shape)?;
        if let Some(sigma) = &self.sigma {
            same_shape("sigma", sigma.dim(), shape)?;
        }
        let mut pixels = Zip::from(self.prediction).and(self.truth).map_collect(|&p, &g| {
            let g = f64::from(g);
            p > 0.0 && p.is_finite() && g > config.min_depth && g < config.max_depth
        });
        if let Some(mask) = self.mask {
            same_shape("the mask", mask.dim(), shape)?;
            pixels.zip_mut_with(&mask, |keep, &also| *keep &= also);
        }
        if let Some([top, bottom, left, right]) = config.crop {
            pixels.indexed_iter_mut().for_each(|((y, x), keep)| {
                *keep &= (top..bottom).contains(&y) && (left..right).contains(&x);
            });
        }
        if pixels.iter().any(|&keep| keep) { Ok(pixels) } else { Err(Error::Empty("the scores")) }
    }

    /// Fits the rule of `config` to the pixels that count.
    ///
    /// # Errors
    /// As [`Subject::pixels`] and [`AlignmentRule::fit`].
    pub fn fit(&self, config: &ScoreConfig) -> Result<Alignment> {
        config.validate()?;
        let pixels = self.pixels(config)?;
        let of = |map| crate::raster::gather(map, pixels.view());
        config.alignment.fit(&of(self.prediction), &of(self.truth))
    }
}

/// All scores of one prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Scores {
    /// The rule that `alignment` was fitted by, nothing where it was handed in ([`score_aligned`]).
    pub rule: Option<AlignmentRule>,
    /// Alignment of the prediction to the truth.
    pub alignment: Alignment,
    /// Pixels scored.
    pub pixels: usize,
    /// By the key of one of [`METRICS`]; what is not defined (edges of a scene without edges) or not finite is left out.
    #[serde(flatten)]
    pub values: BTreeMap<String, f64>,
    /// Curves of the uncertainty, where there is one.
    #[serde(skip)]
    pub curves: Option<UncertaintyCurves>,
}

impl Scores {
    /// The value of the metric of that key.
    pub fn get(&self, key: &str) -> Option<f64> {
        self.values.get(key).copied()
    }
}

/// Aligns a prediction by the rule of `config` (its own alignment) and scores it.
///
/// # Errors
/// [`Error::Shape`], [`Error::Empty`] and [`Error::Config`]; see [`Subject::pixels`] and [`ScoreConfig::validate`].
pub fn score(subject: &Subject<'_>, config: &ScoreConfig) -> Result<Scores> {
    let scores = score_aligned(subject, &subject.fit(config)?, config)?;
    Ok(Scores { rule: Some(config.alignment), ..scores })
}

/// Scores a prediction under a given alignment, such as the baseline's (a *shared* alignment).
///
/// # Errors
/// As [`score`].
pub fn score_aligned(subject: &Subject<'_>, alignment: &Alignment, config: &ScoreConfig) -> Result<Scores> {
    let aligned = Aligned::new(subject, alignment, config)?;
    let (depth, uncertainty) = rayon::join(|| aligned.depth_values(), || aligned.uncertainty());
    let (mut values, (of_sigma, curves)) = (depth?, uncertainty?);
    values.extend(of_sigma);
    Ok(aligned.scores(values, curves))
}

/// Scores of the uncertainty alone, for another sigma of a depth that is scored already. No value where no pixel has an uncertainty.
///
/// # Errors
/// As [`score`].
pub fn score_uncertainty(
    subject: &Subject<'_>,
    alignment: &Alignment,
    config: &ScoreConfig,
) -> Result<Scores> {
    let aligned = Aligned::new(subject, alignment, config)?;
    let (values, curves) = aligned.uncertainty()?;
    Ok(aligned.scores(values, curves))
}

type Values = BTreeMap<String, f64>;

/// The values of all metrics that have a finite one.
fn values(of: impl Fn(Of) -> Result<Option<f64>> + Sync) -> Result<Values> {
    let value = |metric: &Metric| {
        let finite = of(metric.of).map(|value| value.filter(|value| value.is_finite()));
        finite.map(|value| Some((metric.key.to_owned(), value?))).transpose()
    };
    METRICS.into_par_iter().filter_map(value).collect()
}

/// Both maps, 0 where a pixel does not count.
struct Aligned<'s> {
    subject: Subject<'s>,
    alignment: Alignment,
    depth: Array2<f32>,
    truth: Array2<f32>,
    pixels: Array2<bool>,
}

impl<'s> Aligned<'s> {
    fn new(subject: &Subject<'s>, alignment: &Alignment, config: &ScoreConfig) -> Result<Self> {
        config.validate()?;
        let pixels = subject.pixels(config)?;
        let depth = Zip::from(subject.prediction).and(&pixels).map_collect(|&p, &keep| {
            // What does not count is never read, but it must be a number.
            let clipped = alignment.depth(f64::from(p)).max(config.min_depth).min(config.max_depth).max(1e-6);
            if keep { clipped as f32 } else { 0.0 }
        });
        let truth = Zip::from(subject.truth).and(&pixels).map_collect(|&g, &keep| if keep { g } else { 0.0 });
        Ok(Self { subject: *subject, alignment: *alignment, depth, truth, pixels })
    }

    fn depth_values(&self) -> Result<Values> {
        let truth = self.subject.cache.unwrap_or(&TruthCache::default()).truth(&self.truth, &self.pixels)?;
        let found = DepthMap::new(self.depth.view(), &truth)?;
        values(|of| match of {
            Of::Depths(metric) => metric(&found.predicted, &found.true_depths).map(Some),
            Of::Shared(metric) => Ok(metric(&found)),
            Of::Errors(_) | Of::Sigma(_) | Of::Evaluation => Ok(None),
        })
    }

    /// Values and curves of the uncertainty; nothing where there is none.
    fn uncertainty(&self) -> Result<(Values, Option<UncertaintyCurves>)> {
        let Some(found) = SigmaMap::new(self)? else { return Ok(Default::default()) };
        let values = values(|of| match of {
            Of::Errors(metric) => metric(&found.errors, &found.sigma).map(Some),
            Of::Sigma(metric) => Ok(metric(&found)),
            Of::Depths(_) | Of::Shared(_) | Of::Evaluation => Ok(None),
        })?;
        Ok((values, Some(found.curves)))
    }

    fn scores(&self, values: Values, curves: Option<UncertaintyCurves>) -> Scores {
        let pixels = self.pixels.iter().filter(|&&keep| keep).count();
        Scores { rule: None, alignment: self.alignment, pixels, values, curves }
    }
}
