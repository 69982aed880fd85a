//! The prior's stage (III.B): a single prediction, or test-time augmentation with its variance.

use crate::config::Config;
use crate::error::{Error, Result};
use crate::reports::{AugmentationReport, Component};
use mde_prior::augment::{Plan, Predictions, Progress};
use mde_prior::{Augmented, Certainty, DepthPrior};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::filter::{Border, Gaussian, gaussian_blur};
use mde_uncertainty::statistics::median;
use ndarray::{Array2, ArrayView2, ArrayView3, Zip};
use std::ops::ControlFlow;

/// The result of the prior's stage.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Start {
    /// The model's prediction of the whole image, `[height, width]`; 0 where missing.
    pub(crate) prior: Array2<f32>,
    /// The merged depth; [exact](known) where there is one prediction, since it states no error.
    pub(crate) depth: GaussianDepth,
    pub(crate) components: Vec<Component>,
    /// How sure the model itself is.
    pub(crate) certainty: Option<Certainty>,
    pub(crate) report: AugmentationReport,
}

/// Runs the prior, with test-time augmentation where it is configured and the prior accepts new images.
pub(crate) fn predict(
    model: &dyn DepthPrior,
    image: ArrayView3<'_, f32>,
    config: &Config,
    at_once: Option<usize>,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Start> {
    let mut report = AugmentationReport { predictions: 1, ..AugmentationReport::default() };
    let single = |prior: Array2<f32>, certainty, report| {
        Ok(Start { depth: known(prior.clone())?, prior, components: Vec::new(), certainty, report })
    };
    if !(config.augmentation.is_active() && model.accepts_new_images()) {
        if config.augmentation.is_active() {
            report.fewer = Some(
                "no test-time augmentation: the prior does not accept new images; give {prior-model} to use it"
                    .to_owned(),
            );
        }
        let mut predicted = model.predict(image)?;
        let certainty = predicted.certainty.take();
        return single(predicted.to_depth(&config.disparity)?, certainty, report);
    }
    let mut augmented =
        config.augmentation.predict_with(model, image, at_once, progress)?.ok_or(Error::Interrupted)?;
    let certainty = augmented.prior.certainty.take();
    let prior = augmented.prior.to_depth(&config.disparity)?;
    report.predictions = augmented.plan.predictions();
    report.reason = Some(reason(&augmented, config.augmentation.predictions));
    if let Predictions::Most(wanted) = config.augmentation.predictions {
        let (height, width) = prior.dim();
        let input = model.resolution(height, width);
        let all = Plan::new(Predictions::Most(u32::MAX), (height, width), input).predictions();
        report.fewer = (wanted as usize > all).then(|| format!(
            "{{predictions}} {wanted}: {all} are made; smaller crops have less than half the pixels of the model's input along a side"
        ));
    }
    report.plan = Some(augmented.plan.clone());
    if report.predictions == 1 {
        return single(prior, certainty, report);
    }
    let depth = augmented.depth(&config.disparity)?;
    let (components, variance) = variance(&augmented, prior.view(), depth.view(), config, &mut report)?;
    Ok(Start { prior, depth: GaussianDepth::new(depth, variance)?, components, certainty, report })
}

/// What decided the plan.
fn reason(augmented: &Augmented, wanted: Predictions) -> String {
    let detail = match augmented.plan.ratio {
        Some(ratio) => format!("the image has {ratio:.1} times the pixels of the model's input along a side"),
        None => "the size of the model's input is unknown".to_owned(),
    };
    let limit = match wanted {
        Predictions::Auto => "auto".to_owned(),
        Predictions::Most(most) => format!("{most} at most"),
    };
    let end = augmented.stopped.map_or_else(String::new, |n| {
        format!("; no smaller crops, since those of {n} x {n} moved the map by less than they differ")
    });
    format!("{limit}: {detail}{end}")
}

/// A map of depths (0: missing) taken as exact, of variance 0: warps of it are exact too, and the fusion estimates its error.
pub fn known(depth: Array2<f32>) -> Result<GaussianDepth> {
    let variance = depth.mapv(|d| if d > 0.0 { 0.0 } else { f32::INFINITY });
    Ok(GaussianDepth::new(depth, variance)?)
}

/// Error that all predictions share over the median of what they do not share: where predictions of a photograph differ by more,
/// they are wrong together by more, too. Measured with two networks (docs/results.md).
const SHARED: f64 = 1.5;

/// The parts of sigma, and the variance that they make without the common error. Their medians go into the report.
fn variance(
    augmented: &Augmented,
    prior: ArrayView2<'_, f32>,
    depth: ArrayView2<'_, f32>,
    config: &Config,
    report: &mut AugmentationReport,
) -> Result<(Vec<Component>, Array2<f32>)> {
    let spread = augmented.relative_spread(depth)?;
    let change = Zip::from(depth)
        .and(prior)
        .map_collect(|&z, &o| if z > 0.0 && o > 0.0 { (z / o).ln().abs() } else { 0.0 });
    let middle = |map: &Array2<f32>| median(map.iter().copied().filter(|v| v.is_finite()));
    (report.median_spread, report.median_change) = (middle(&spread), middle(&change));
    let blur = Gaussian::new(config.sigma.blur * depth.ncols() as f64, 3.0);
    let squared = |share: &Array2<f32>, gain: f64| {
        let raw = share.mapv(|s| (gain as f32 * s).powi(2));
        gaussian_blur(raw.view(), blur, blur, Border::Mirror)
    };
    let [spread, change] =
        [squared(&spread, config.sigma.spread), squared(&change, config.sigma.disagreement)];
    let variance = Zip::from(depth).and(&spread).and(&change).map_collect(|&z, &s, &d| {
        // Predictions that agree still share an error: no depth is exact.
        if z > 0.0 { ((s + d).max(1e-6) * z * z).max(f32::MIN_POSITIVE) } else { f32::INFINITY }
    });
    let own = Zip::from(&spread).and(&change).map_collect(|&s, &d| (s + d).max(0.0).sqrt());
    let own = own.iter().zip(depth).filter(|(s, z)| **z > 0.0 && s.is_finite());
    let own = median(own.map(|(s, _)| f64::from(*s))).unwrap_or(0.0);
    let common = config.fusion.common_error;
    report.common_error = Some(if common > 0.0 { common.hypot(SHARED * own) } else { 0.0 });
    let component = |name, squared: &Array2<f32>| {
        let sigma = Zip::from(depth)
            .and(squared)
            .map_collect(|&z, &s| if z > 0.0 { z * s.max(0.0).sqrt() } else { f32::INFINITY });
        Component { name, sigma }
    };
    Ok((vec![component("spread", &spread), component("disagreement", &change)], variance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_prior::{DepthKind, PriorDepth};

    #[test]
    fn the_reason_names_the_level_that_ended_the_plan() {
        let prior = PriorDepth::from_values(Array2::ones((2, 2)), DepthKind::Metric).unwrap();
        let plan = Plan { mirror: true, levels: vec![2], ratio: Some(2.5) };
        let spread = Array2::zeros((2, 2));
        let mut augmented = Augmented { merged: prior.clone(), prior, spread, plan, stopped: None };
        let told = reason(&augmented, Predictions::Auto);
        assert_eq!(told, "auto: the image has 2.5 times the pixels of the model's input along a side");
        augmented.stopped = Some(2);
        assert!(reason(&augmented, Predictions::Auto).contains("those of 2 x 2 moved the map by less"));
    }
}
