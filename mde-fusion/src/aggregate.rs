use crate::gaussian::{least_variance, relative_precision, to_f32};
use crate::{Error, Gaussian, Result};
use mde_uncertainty::GaussianDepth;

/// Rule that turns the views' estimates of one pixel into one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Aggregation {
    /// Eq. 7-8: weighted by precision.
    #[default]
    Precision,
    /// The mean of Eq. 7 with the variance of the mixture of the views, in place of Eq. 8, which assumes independent views.
    Mixture,
    /// The nearest surface, with its view's variance (the smaller one of equally near views).
    MinDepth,
}

/// Aggregates the depth of many views per pixel: Eq. 7-8, or another [`Aggregation`].
///
/// All maps are `[height, width]`, reprojected into one camera. A view that is missing at a pixel does not count there, and a pixel that
/// every view misses stays missing (\\(\tau_r = 0\\)). The order of the views does not matter.
///
/// Without views the map is empty, `[0, 0]`.
///
/// # Errors
/// [`Error::Shape`] for a view of another size than the first.
///
/// ```
/// use mde_fusion::{Aggregation, GaussianDepth, aggregate, ndarray::array};
///
/// let near = GaussianDepth::new(array![[2.0, 5.0]], array![[0.1, f32::INFINITY]])?;
/// let far = GaussianDepth::new(array![[3.0, 5.0]], array![[0.3, f32::INFINITY]])?;
/// let both = aggregate(&[near, far], Aggregation::Precision)?;
/// let (mean, variance) = both.get(0, 0).ok_or("known by both")?;
/// assert!((mean - 2.25).abs() < 1e-6 && (variance - 0.075).abs() < 1e-7);
/// assert_eq!(both.get(0, 1), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn aggregate(views: &[GaussianDepth], rule: Aggregation) -> Result<GaussianDepth> {
    let (height, width) = views.first().map_or((0, 0), GaussianDepth::dim);
    check_shapes(views, (height, width))?;
    let mut pixels: Vec<_> = views.iter().map(|view| view.mean().into_iter().zip(view.variance())).collect();
    let mut estimates = Vec::with_capacity(views.len());
    let (mut mean, mut variance) = GaussianDepth::missing(height, width).into_parts();
    for (mean, variance) in mean.iter_mut().zip(&mut variance) {
        let known = pixels.iter_mut().filter_map(Iterator::next).filter(|(_, v)| v.is_finite());
        estimates.clear();
        estimates.extend(known.map(|(&m, &v)| Gaussian::new(f64::from(m), f64::from(v))));
        let nearest =
            |a: &&Gaussian, b: &&Gaussian| a.mean.total_cmp(&b.mean).then(a.variance.total_cmp(&b.variance));
        let combined = match rule {
            Aggregation::Precision => precision_weighted(&estimates),
            Aggregation::Mixture => precision_weighted(&estimates)
                .map(|g| Gaussian { variance: mixture_variance(&estimates, g.mean), ..g }),
            Aggregation::MinDepth => estimates.iter().min_by(nearest).copied(),
        };
        if let Some(g) = combined {
            (*mean, *variance) = (to_f32(g.mean), to_f32(g.variance));
        }
    }
    Ok(GaussianDepth::new(mean, variance)?)
}

pub(crate) fn check_shapes(views: &[GaussianDepth], expected: (usize, usize)) -> Result<()> {
    match views.iter().enumerate().find(|(_, view)| view.dim() != expected) {
        Some((view, map)) => Err(Error::Shape { view, expected: expected.into(), found: map.dim().into() }),
        None => Ok(()),
    }
}

/// Precision-weighted mean of independent estimates (Eq. 7-8).
///
/// \\[ \tau_r = \sum_{j\in\mathcal V} \frac{1}{(\sigma_r^2)^{(j)}},\qquad
/// \mu_r^{\mathrm{agg}} = \frac{1}{\tau_r} \sum_{j\in\mathcal V} \frac{\mu_r^{(j)}}{(\sigma_r^2)^{(j)}},\qquad
/// (\sigma_r^2)^{\mathrm{agg}} = \frac{1}{\tau_r} \\]
///
/// `None` where there is no estimate, that is \\(\tau_r = 0\\). The weights are taken relative to the largest, so
/// that no precision overflows. Estimates of variance 0 are exact: their plain mean is the limit, with variance 0.
pub fn precision_weighted(estimates: &[Gaussian]) -> Option<Gaussian> {
    let least = least_variance(estimates.iter().map(|g| g.variance));
    let first = estimates.first().filter(|_| least.is_finite())?;
    let (mut tau, mut offset) = (0.0, 0.0);
    // About the first estimate: equal estimates then give exactly themselves.
    for g in estimates {
        let weight = relative_precision(least, g.variance);
        tau += weight;
        offset += weight * (g.mean - first.mean);
    }
    Some(Gaussian::new(first.mean + offset / tau, least / tau))
}

/// Variance of the mixture of the views with the weights of Eq. 7, which does not assume that their errors are independent.
///
/// \\[ \sigma^2_{\mathrm{mix}} = \frac{|\mathcal V|}{\tau_r} + \sum_j \frac{\tau_j}{\tau_r}
/// \bigl(\mu_r^{(j)} - \mu_r^{\mathrm{agg}}\bigr)^2,\qquad \tau_j = 1/(\sigma_r^2)^{(j)} \\]
///
/// The first term is \\(\sum_j \tfrac{\tau_j}{\tau_r} (\sigma_r^2)^{(j)}\\), so this is the law of total variance. Eq. 8 divides the
/// variance by the number of views. Renders of one field share their error, so that Eq. 8 is too small by up to that number.
///
/// `mean` is \\(\mu_r^{\mathrm{agg}}\\). 0 without estimates.
pub(crate) fn mixture_variance(estimates: &[Gaussian], mean: f64) -> f64 {
    let least = least_variance(estimates.iter().map(|g| g.variance));
    let (mut tau, mut second) = (0.0, 0.0);
    for g in estimates {
        let weight = relative_precision(least, g.variance);
        tau += weight;
        // weight * variance is `least` for every estimate of variance > 0, and 0 where one is exact.
        second += least + weight * (g.mean - mean).powi(2);
    }
    if tau > 0.0 { second / tau } else { 0.0 }
}
