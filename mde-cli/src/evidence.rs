//! The prior's stage (III.B): what the model says, asked once or many times, and how sure that is.

use crate::config::Config;
use crate::config::SigmaConfig;
use crate::{Error, Result};
use mde_prior::{DepthPrior, Evidence};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use ndarray::{Array2, ArrayView2, ArrayView3, Zip};
use serde::Serialize;
use std::ops::ControlFlow;

/// What the prior's stage gave.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Start {
    /// The model's first answer, `[height, width]`; 0 where missing.
    pub(crate) prior: Array2<f32>,
    /// What all answers say together; variance 0 where the model was asked once, which says nothing of its error.
    pub(crate) depth: GaussianDepth,
    /// What the variance is made of.
    pub(crate) components: Vec<Component>,
    pub(crate) report: EvidenceReport,
}

/// A part of the refined depth's standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// `spread`: of the hypotheses. `disagreement`: with the first answer. `common`: the error that no hypothesis shows. `field`: of
    /// the rays' ends, over all views, in the prior's gauge.
    pub name: &'static str,
    /// `[height, width]`, in the depth's unit; infinite where missing.
    pub sigma: Array2<f32>,
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
        return Ok(Start { depth: known(prior.clone())?, prior, components: Vec::new(), report });
    }
    let evidence = config.evidence.gather_with(model, image, observe)?.ok_or(Error::Interrupted)?;
    let prior = evidence.prior.to_depth(&config.disparity)?;
    let depth = evidence.depth(&config.disparity)?;
    report.questions = evidence.questions;
    let (components, variance) = variance(&evidence, prior.view(), depth.view(), &config.sigma, &mut report)?;
    Ok(Start { prior, depth: GaussianDepth::new(depth, variance)?, components, report })
}

/// A map of depths (0: missing) as a Gaussian depth whose variance is not known yet (0).
pub fn known(depth: Array2<f32>) -> Result<GaussianDepth> {
    let variance = depth.mapv(|d| if d > 0.0 { 0.0 } else { f32::INFINITY });
    Ok(GaussianDepth::new(depth, variance)?)
}

/// The parts of sigma, and the variance that they make without the common error. The report hears of their medians.
fn variance(
    evidence: &Evidence,
    prior: ArrayView2<'_, f32>,
    depth: ArrayView2<'_, f32>,
    config: &SigmaConfig,
    report: &mut EvidenceReport,
) -> Result<(Vec<Component>, Array2<f32>)> {
    let spread = evidence.relative_spread(depth)?;
    let change = Zip::from(depth)
        .and(prior)
        .map_collect(|&z, &o| if z > 0.0 && o > 0.0 { (z / o).ln().abs() } else { 0.0 });
    let middle = |map: &Array2<f32>| median(map.iter().copied().filter(|v| v.is_finite()));
    (report.median_spread, report.median_change) = (middle(&spread), middle(&change));
    let width = config.blur * depth.ncols() as f64;
    let squared = |share: &Array2<f32>, gain: f64| {
        let raw = share.mapv(|s| (gain as f32 * s).powi(2));
        mde_prior::evidence::blurred(raw.view(), (width, width))
    };
    let [spread, change] = [squared(&spread, config.spread), squared(&change, config.disagreement)];
    let variance = Zip::from(depth).and(&spread).and(&change).map_collect(|&z, &s, &d| {
        // Hypotheses that all say the same still share an error; without it a variance of 0 would mean "not known".
        if z > 0.0 { ((s + d).max(1e-6) * z * z).max(f32::MIN_POSITIVE) } else { f32::INFINITY }
    });
    let component = |name, squared: &Array2<f32>| {
        let sigma = Zip::from(depth)
            .and(squared)
            .map_collect(|&z, &s| if z > 0.0 { z * s.max(0.0).sqrt() } else { f32::INFINITY });
        Component { name, sigma }
    };
    Ok((vec![component("spread", &spread), component("disagreement", &change)], variance))
}
