use super::ScoreConfig;
use crate::Result;
use crate::align::Alignment;
use crate::metrics::calibration;
use crate::metrics::sparsification::{Costs, Reduction, Sparsification, bin, spearman_of_bins};
use mde_uncertainty::statistics::{Order, pearson, quantile_sorted};
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};

/// Scores of the standard deviations of one aligned depth map. Errors are aligned prediction minus truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct UncertaintyScores {
    /// Pixels with an uncertainty.
    pub pixels: usize,
    /// [Spearman's correlation](crate::metrics::rank::spearman) of sigma and \\(|e|\\) over pixels; nothing where one of them is constant.
    pub spearman: Option<f64>,
    /// [The same](spearman_of_bins) over the means of percentile bins of sigma.
    pub spearman_binned: Option<f64>,
    /// Sparsification by \\(|e|\\) after [Bayes' Rays](crate::metrics::sparsification::sparsify).
    pub mae: AreaScores,
    /// Sparsification by RMSE after Bayes' Rays.
    pub rmse: AreaScores,
    /// [Spearman's correlation](crate::metrics::rank::spearman) of sigma over depth and \\(|e|/g\\), \\(g\\) the truth: without the share that
    /// comes from both growing with depth. Nothing where sigma is proportional to depth.
    pub spearman_relative: Option<f64>,
    /// Sparsification by \\(|e|/g\\) in order of sigma over depth, after Bayes' Rays. A sigma proportional to depth is at chance.
    pub relative: AreaScores,
    /// Sparsification by AbsRel after [Poggi et al.](crate::metrics::sparsification::sparsify_poggi)
    pub poggi_abs_rel: AreaScores,
    /// Sparsification by RMSE after Poggi et al., m.
    pub poggi_rmse: AreaScores,
    /// Sparsification by the share of outliers (beyond a factor 1.25) after Poggi et al., their `a1`.
    pub poggi_a1: AreaScores,
    /// [Negative log-likelihood](calibration::nll), nats per pixel.
    pub nll: f64,
    /// [Continuous ranked probability score](calibration::crps), m.
    pub crps: f64,
    /// [Coverage](calibration::coverage) of central intervals.
    pub coverage: Vec<CoverageScore>,
    /// [Mean absolute calibration error](calibration::mace).
    pub mace: f64,
    /// [Its root-mean-square kin](calibration::CalibrationErrors::root_mean_square).
    pub rmsce: f64,
    /// [Area between observed and stated coverage](calibration::CalibrationErrors::area).
    pub miscalibration_area: f64,
    /// [Expected normalised calibration error](calibration::ence).
    pub ence: f64,
    /// [Mean squared z](calibration::mean_z2), 1 where the sigmas are right, above 1 where they are too small.
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
    /// Nominal probability of the interval.
    pub nominal: f64,
    /// Share of the truths within it.
    pub observed: f64,
}

/// Curves of the uncertainty of one map, for figures and for factors of sigma fitted on other maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct UncertaintyCurves {
    /// Mean \\(|e|\\) by percentile of sigma, m: 100 bins, or as many as there are pixels.
    pub error_by_percentile: Vec<f64>,
    /// Mean sigma of the same bins, m.
    pub sigma_by_percentile: Vec<f64>,
    /// Share of pixels removed: 0, 0.01, ..., 0.99.
    pub removed: Vec<f64>,
    /// Mean \\(|e|\\) of the rest when the most uncertain go, over the [joint maximum](crate::metrics::sparsification::sparsify).
    pub by_sigma: Vec<f64>,
    /// The same when the worst go.
    pub oracle: Vec<f64>,
    /// The same of all pixels.
    pub random: f64,
    /// Quantiles of \\(|z| = |e| / \sigma\\) at 0, 0.01, ..., 1.
    pub abs_z_quantiles: Vec<f64>,
}

/// Pixels with an uncertainty, as lists by rising sigma: what follows that order then runs along memory.
pub(super) struct Lists {
    errors: Vec<f64>,
    sigma: Vec<f64>,
    truth: Vec<f64>,
    absolute: Vec<f64>,
    /// Of sigma.
    order: Order,
}

/// Nothing where no pixel has an uncertainty.
pub(super) fn gather(
    prediction: ArrayView2<'_, f32>,
    sigma: ArrayView2<'_, f32>,
    (aligned, truth, pixels): (ArrayView2<'_, f32>, ArrayView2<'_, f32>, &Array2<bool>),
    alignment: &Alignment,
) -> Result<Option<Lists>> {
    let (mut errors, mut sigmas, mut truths) = (Vec::new(), Vec::new(), Vec::new());
    let values = prediction.into_iter().zip(sigma).zip(aligned).zip(truth).zip(pixels);
    for ((((&p, &sigma), &aligned), &truth), &keep) in values {
        let scaled = alignment.sigma(f64::from(p), f64::from(sigma));
        if keep && sigma > 0.0 && scaled > 0.0 && scaled.is_finite() {
            errors.push(f64::from(aligned) - f64::from(truth));
            sigmas.push(scaled);
            truths.push(f64::from(truth));
        }
    }
    if errors.is_empty() {
        return Ok(None);
    }
    let order = Order::new(&sigmas)?;
    let [errors, sigma, truth] = [&errors, &sigmas, &truths].map(|values| order.apply(values));
    let absolute = errors.iter().map(|e: &f64| e.abs()).collect();
    Ok(Some(Lists { order: Order::of_sorted(&sigma), errors, sigma, truth, absolute }))
}

pub(super) fn scores(lists: &Lists, config: &ScoreConfig) -> Result<UncertaintyScores> {
    let Lists { errors, sigma, truth, absolute, order } = lists;
    let squared: Vec<f64> = errors.iter().map(|e| e * e).collect();
    let relative: Vec<f64> = absolute.iter().zip(truth).map(|(e, g)| e / g).collect();
    let relative_sigma: Vec<f64> =
        sigma.iter().zip(errors).zip(truth).map(|((s, e), g)| s / (g + e).max(f64::MIN_POSITIVE)).collect();
    let by_relative_sigma = Order::new(&relative_sigma)?;
    let outlier = |(e, g): (&f64, &f64)| f64::from(u8::from((g + e).max(*g) >= 1.25 * (g + e).min(*g)));
    let outliers: Vec<f64> = errors.iter().zip(truth).map(outlier).collect();
    let by_error = Order::new(absolute)?;
    let sorted = by_error.apply(absolute);
    let sorted_squares: Vec<f64> = sorted.iter().map(|e| e * e).collect();
    let by_square = Costs::with_sorted(&squared, sigma, order, &sorted_squares)?;
    let by_error_size = Costs::with_sorted(absolute, sigma, order, &sorted)?;
    let costs = |values: &[f64]| Costs::new(values, sigma, order);
    let coverage = |&nominal: &f64| {
        Ok(CoverageScore { nominal, observed: calibration::coverage(errors, sigma, nominal)? })
    };
    let calibrated = calibration::calibration_errors(errors, sigma)?;
    Ok(UncertaintyScores {
        pixels: errors.len(),
        spearman: pearson(&order.ranks(), &by_error.ranks()),
        spearman_binned: spearman_of_bins(&bin(absolute, sigma, order, config.spearman_bins)?)?,
        mae: by_error_size.normalised(Reduction::Mean)?.into(),
        rmse: by_square.normalised(Reduction::RootMean)?.into(),
        spearman_relative: pearson(&by_relative_sigma.ranks(), &Order::new(&relative)?.ranks()),
        relative: Costs::new(&relative, &relative_sigma, &by_relative_sigma)?
            .normalised(Reduction::Mean)?
            .into(),
        poggi_abs_rel: costs(&relative)?.poggi(Reduction::Mean)?.into(),
        poggi_rmse: by_square.poggi(Reduction::RootMean)?.into(),
        poggi_a1: costs(&outliers)?.poggi(Reduction::Mean)?.into(),
        nll: calibration::nll(errors, sigma)?,
        crps: calibration::crps(errors, sigma)?,
        coverage: config.levels.iter().map(coverage).collect::<Result<_>>()?,
        mace: calibrated.mean,
        rmsce: calibrated.root_mean_square,
        miscalibration_area: calibrated.area,
        ence: calibration::ence_in_order(errors, sigma, order, config.ence_bins)?,
        mean_z2: calibration::mean_z2(errors, sigma)?,
        rms_sigma: calibration::rms_sigma(errors, sigma)?,
    })
}

pub(super) fn curves(lists: &Lists) -> Result<UncertaintyCurves> {
    let Lists { errors, sigma, absolute, order, .. } = lists;
    let bins = bin(absolute, sigma, order, 100)?;
    let Sparsification { removed, by_sigma, oracle, random } =
        Costs::new(absolute, sigma, order)?.normalised(Reduction::Mean)?;
    let mut z: Vec<f64> = errors.iter().zip(sigma).map(|(e, s)| (e / s).abs()).collect();
    z.sort_unstable_by(f64::total_cmp);
    Ok(UncertaintyCurves {
        error_by_percentile: bins.iter().map(|bin| bin.cost).collect(),
        sigma_by_percentile: bins.iter().map(|bin| bin.sigma).collect(),
        removed,
        by_sigma,
        oracle,
        random,
        abs_z_quantiles: (0..=100).filter_map(|k| quantile_sorted(&z, f64::from(k) / 100.0)).collect(),
    })
}
