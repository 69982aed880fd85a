//! The prior's stage (III.B): what the model says, asked once or many times, and how sure that is.

use crate::config::Config;
use crate::pipeline::known;
use crate::{Error, Result};
use mde_prior::{DepthPrior, Evidence};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, ArrayView2, ArrayView3, Zip};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// How sure the evidence is: the variance of a pixel as a share of its squared depth,
///
/// \\[ \frac{\sigma^2}{z^2} = G * \Bigl(k_s^2 s^2 + k_d^2 \ln^2\frac{z}{z_o}\Bigr) + \sigma_c^2, \\]
///
/// with \\(s\\) the spread of the hypotheses, \\(z_o\\) the model's first answer, \\(G\\) a Gaussian blur, and
/// \\(\sigma_c\\) the error that all hypotheses share ([`mde_fusion::FusionConfig::common_error`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct SigmaConfig {
    /// \\(k_s\\), 0 or more.
    pub spread: f64,
    /// \\(k_d\\), 0 or more.
    pub disagreement: f64,
    /// Standard deviation of the blur as a share of the picture's width.
    pub blur: f64,
}

impl Default for SigmaConfig {
    fn default() -> Self {
        Self { spread: 1.2, disagreement: 0.6, blur: 0.025 }
    }
}

impl SigmaConfig {
    pub(crate) fn validate(&self) -> Result<()> {
        let fields = [
            ("spread", self.spread, 100.0),
            ("disagreement", self.disagreement, 100.0),
            ("blur", self.blur, 0.25),
        ];
        for (name, value, most) in fields {
            if !(0.0..=most).contains(&value) {
                let reason = format!("sigma.{name} is {value}; give 0 to {most}");
                return Err(Error::Config { origin: "config".into(), reason });
            }
        }
        Ok(())
    }
}

/// What the prior's stage gave.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Start {
    /// The model's first answer, `[height, width]`; 0 where missing.
    pub(crate) prior: Array2<f32>,
    /// What all answers say together; variance 0 where the model was asked once, which says nothing of its error.
    pub(crate) depth: GaussianDepth,
    pub(crate) report: EvidenceReport,
}

/// An account of the prior's stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct EvidenceReport {
    /// How often the model was asked.
    pub questions: usize,
    /// Why it was not asked again though the settings say so.
    pub not_asked_again: Option<&'static str>,
    /// Median spread of the hypotheses, as a share of the depth.
    pub median_spread: Option<f64>,
    /// Median of \\(|\ln z - \ln z_o|\\): how far the hypotheses moved the first answer.
    pub median_change: Option<f64>,
    /// Wall seconds.
    pub seconds: f64,
}

/// Asks the prior as often as the configuration says and it can answer.
pub(crate) fn start(
    model: &dyn DepthPrior,
    image: ArrayView3<'_, f32>,
    config: &Config,
    observe: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Start> {
    let mut report = EvidenceReport { questions: 1, ..EvidenceReport::default() };
    if !(config.evidence.asks_again() && model.answers_anew()) {
        if config.evidence.asks_again() {
            report.not_asked_again = Some("the prior is a map, not a model");
        }
        let prior = model.predict(image)?.to_depth(&config.disparity)?;
        return Ok(Start { depth: known(prior.clone())?, prior, report });
    }
    let evidence = config.evidence.gather_with(model, image, observe)?.ok_or(Error::Interrupted)?;
    let prior = evidence.prior.to_depth(&config.disparity)?;
    let depth = evidence.depth(&config.disparity)?;
    let (variance, spread, change) = variance(&evidence, prior.view(), depth.view(), config)?;
    report.questions = evidence.questions;
    report.median_spread = spread;
    report.median_change = change;
    Ok(Start { prior, depth: GaussianDepth::new(depth, variance)?, report })
}

/// Variance without the common error, and the medians of the spread and the change.
fn variance(
    evidence: &Evidence,
    prior: ArrayView2<'_, f32>,
    depth: ArrayView2<'_, f32>,
    config: &Config,
) -> Result<(Array2<f32>, Option<f64>, Option<f64>)> {
    let sigma = &config.sigma;
    let spread = evidence.relative_spread(depth)?;
    let change = Zip::from(depth)
        .and(prior)
        .map_collect(|&z, &o| if z > 0.0 && o > 0.0 { (z / o).ln().abs() } else { 0.0 });
    let (ks, kd) = (sigma.spread as f32, sigma.disagreement as f32);
    let raw = Zip::from(&spread).and(&change).map_collect(|&s, &d| (ks * s).powi(2) + (kd * d).powi(2));
    let width = sigma.blur * depth.ncols() as f64;
    let smooth = mde_prior::evidence::blurred(raw.view(), (width, width));
    let variance = Zip::from(depth).and(&smooth).map_collect(|&z, &v| {
        // Hypotheses that all say the same still share an error; without it a variance of 0 would mean "not known".
        if z > 0.0 { (v.max(1e-6) * z * z).max(f32::MIN_POSITIVE) } else { f32::INFINITY }
    });
    let median = |map: &Array2<f32>| mde_warp::median(map.iter().copied()).map(f64::from);
    Ok((variance, median(&spread), median(&change)))
}
