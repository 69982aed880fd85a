use super::Aligned;
use crate::Result;
use crate::metrics::sparsification::Reduction::{Mean, RootMean};
use crate::metrics::sparsification::{Sparsification, costs_by_uncertainty, sparsify};
use mde_uncertainty::statistics::{Order, quantile_sorted, spearman};
use serde::{Deserialize, Serialize};

/// Curves of the uncertainty of one map, for figures and for factors of sigma fitted on other maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct UncertaintyCurves {
    /// Mean \\(|e|\\) by percentile of sigma, m: 100 bins, or as many as there are pixels.
    pub error_by_percentile: Vec<f64>,
    /// Of \\(|e|\\), over the [joint maximum](sparsify).
    #[serde(flatten)]
    pub sparsification: Sparsification,
    /// Quantiles of \\(|z| = |e| / \sigma\\) at 0, 0.01, ..., 1.
    pub abs_z_quantiles: Vec<f64>,
}

/// The pixels with an uncertainty by rising sigma, with what several metrics share.
pub(super) struct SigmaMap {
    /// Aligned prediction minus truth.
    pub(super) errors: Vec<f64>,
    pub(super) sigma: Vec<f64>,
    pub(super) spearman: Option<f64>,
    pub(super) spearman_binned: Option<f64>,
    /// Of sigma over depth and the relative error: without the share that comes from both growing with depth.
    pub(super) spearman_relative: Option<f64>,
    pub(super) rmse: Sparsification,
    /// By relative error in order of sigma over depth: a sigma proportional to depth is at chance.
    pub(super) relative: Sparsification,
    pub(super) curves: UncertaintyCurves,
}

impl SigmaMap {
    /// Nothing where no pixel has an uncertainty.
    pub(super) fn new(aligned: &Aligned<'_>) -> Result<Option<Self>> {
        let Aligned { subject, alignment, depth, truth, pixels } = aligned;
        let Some(sigma) = subject.sigma else { return Ok(None) };
        let values = subject.prediction.iter().zip(sigma).zip(depth).zip(truth).zip(pixels);
        let known = values.filter_map(|((((&p, &sigma), &aligned), &truth), &keep)| {
            let scaled = alignment.sigma(f64::from(p), f64::from(sigma));
            let counts = keep && sigma > 0.0 && scaled > 0.0 && scaled.is_finite();
            counts.then(|| (f64::from(aligned) - f64::from(truth), scaled, f64::from(truth)))
        });
        let (errors, sigmas, truths): (Vec<f64>, Vec<f64>, Vec<f64>) = known.collect();
        if errors.is_empty() {
            return Ok(None);
        }
        // Lists that are sorted already are sorted fast.
        let order = Order::new(&sigmas)?;
        let [errors, sigma, truth] = [&errors, &sigmas, &truths].map(|values| order.apply(values));
        let absolute: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
        let squared: Vec<f64> = errors.iter().map(|e| e * e).collect();
        let relative: Vec<f64> = absolute.iter().zip(&truth).map(|(e, g)| e / g).collect();
        let over_depth = |((s, e), g): ((&f64, &f64), &f64)| s / (g + e).max(f64::MIN_POSITIVE);
        let relative_sigma: Vec<f64> = sigma.iter().zip(&errors).zip(&truth).map(over_depth).collect();
        let bins = costs_by_uncertainty(&absolute, &sigma, 100)?;
        let (mean_sigma, error_by_percentile): (Vec<f64>, Vec<f64>) = bins.into_iter().unzip();
        let mut z: Vec<f64> = errors.iter().zip(&sigma).map(|(e, s)| (e / s).abs()).collect();
        z.sort_unstable_by(f64::total_cmp);
        let abs_z_quantiles = (0..=100).filter_map(|k| quantile_sorted(&z, f64::from(k) / 100.0)).collect();
        Ok(Some(Self {
            spearman: spearman(&sigma, &absolute)?,
            spearman_binned: spearman(&mean_sigma, &error_by_percentile)?,
            spearman_relative: spearman(&relative_sigma, &relative)?,
            rmse: sparsify(&squared, &sigma, RootMean)?,
            relative: sparsify(&relative, &relative_sigma, Mean)?,
            curves: UncertaintyCurves {
                error_by_percentile,
                sparsification: sparsify(&absolute, &sigma, Mean)?,
                abs_z_quantiles,
            },
            errors,
            sigma,
        }))
    }
}
