use super::ScoreConfig;
use crate::Result;
use crate::align::Alignment;
use crate::metrics::calibration;
use crate::metrics::rank::{Order, spearman};
use crate::metrics::sparsification::{Costs, Reduction, Sparsification, bin, spearman_of_bins};
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};

/// Scores of the standard deviations of one aligned depth map. Errors are aligned prediction minus truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct UncertaintyScores {
    /// Pixels with an uncertainty.
    pub pixels: usize,
    /// [Spearman's correlation](spearman) of sigma and \\(|e|\\) over pixels; nothing where one of them is constant.
    pub spearman: Option<f64>,
    /// [The same](spearman_of_bins) over the means of percentile bins of sigma.
    pub spearman_binned: Option<f64>,
    /// Sparsification by \\(|e|\\) after [Bayes' Rays](crate::metrics::sparsification::sparsify).
    pub mae: AreaScores,
    /// Sparsification by RMSE after Bayes' Rays.
    pub rmse: AreaScores,
    /// Sparsification by AbsRel after [Poggi et al.](crate::metrics::sparsification::sparsify_poggi)
    pub poggi_abs_rel: AreaScores,
    /// Sparsification by RMSE after Poggi et al., m.
    pub poggi_rmse: AreaScores,
    /// [Negative log-likelihood](calibration::nll), nats a pixel.
    pub nll: f64,
    /// [Continuous ranked probability score](calibration::crps), m.
    pub crps: f64,
    /// [Coverage](calibration::coverage) of central intervals.
    pub coverage: Vec<CoverageScore>,
    /// [Mean absolute calibration error](calibration::mace).
    pub mace: f64,
    /// [Expected normalised calibration error](calibration::ence).
    pub ence: f64,
    /// [Mean squared z](calibration::mean_z2), 1 where the sigmas are right.
    pub mean_z2: f64,
    /// [Root of the mean variance](calibration::rms_sigma), m.
    pub rms_sigma: f64,
}

/// Area under the sparsification error, and gained over chance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct AreaScores {
    /// [Area between the curve and the oracle's](Sparsification::ause), 0 is best.
    pub ause: f64,
    /// [Area gained over chance](Sparsification::aurg), 0 is chance.
    pub aurg: f64,
}

impl From<Sparsification> for AreaScores {
    fn from(curves: Sparsification) -> Self {
        Self { ause: curves.ause(), aurg: curves.aurg() }
    }
}

/// How many truths lie within a central interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CoverageScore {
    /// Probability that the interval claims.
    pub nominal: f64,
    /// Share of the truths within it.
    pub observed: f64,
}

/// Pixels with an uncertainty, as lists.
pub(super) struct Lists {
    errors: Vec<f64>,
    sigma: Vec<f64>,
    truth: Vec<f64>,
}

pub(super) fn gather(
    prediction: ArrayView2<'_, f32>,
    sigma: ArrayView2<'_, f32>,
    aligned: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    pixels: &Array2<bool>,
    alignment: &Alignment,
) -> Lists {
    let mut lists = Lists { errors: Vec::new(), sigma: Vec::new(), truth: Vec::new() };
    let values = prediction.into_iter().zip(sigma).zip(aligned).zip(truth).zip(pixels);
    for ((((&p, &sigma), &aligned), &truth), &keep) in values {
        let scaled = alignment.sigma(f64::from(p), f64::from(sigma));
        if keep && sigma > 0.0 && scaled > 0.0 && scaled.is_finite() {
            lists.errors.push(f64::from(aligned) - f64::from(truth));
            lists.sigma.push(scaled);
            lists.truth.push(f64::from(truth));
        }
    }
    lists
}

/// Nothing where no pixel has an uncertainty.
pub(super) fn scores(lists: &Lists, config: &ScoreConfig) -> Result<Option<UncertaintyScores>> {
    let Lists { errors, sigma, truth } = lists;
    if errors.is_empty() {
        return Ok(None);
    }
    let order = Order::new("sigma", sigma)?;
    let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    let squared: Vec<f64> = errors.iter().map(|e| e * e).collect();
    let relative: Vec<f64> = absolute.iter().zip(truth).map(|(e, g)| e / g).collect();
    let costs = |values: &[f64]| Costs::new(values, sigma, &order);
    let by_square = costs(&squared)?;
    let coverage = |&nominal: &f64| {
        Ok(CoverageScore { nominal, observed: calibration::coverage(errors, sigma, nominal)? })
    };
    Ok(Some(UncertaintyScores {
        pixels: errors.len(),
        spearman: spearman(sigma, &absolute)?,
        spearman_binned: spearman_of_bins(&bin(&absolute, sigma, &order, config.spearman_bins)?)?,
        mae: costs(&absolute)?.normalised(Reduction::Mean)?.into(),
        rmse: by_square.normalised(Reduction::RootMean)?.into(),
        poggi_abs_rel: costs(&relative)?.poggi(Reduction::Mean)?.into(),
        poggi_rmse: by_square.poggi(Reduction::RootMean)?.into(),
        nll: calibration::nll(errors, sigma)?,
        crps: calibration::crps(errors, sigma)?,
        coverage: config.levels.iter().map(coverage).collect::<Result<_>>()?,
        mace: calibration::mace(errors, sigma)?,
        ence: calibration::ence_in_order(errors, sigma, &order, config.ence_bins)?,
        mean_z2: calibration::mean_z2(errors, sigma)?,
        rms_sigma: calibration::rms_sigma(errors, sigma)?,
    }))
}
