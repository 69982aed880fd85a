use crate::gaussian::to_f32;
use crate::precision::mixture_variance;
use crate::{Error, Gaussian, Result, precision_weighted};
use mde_uncertainty::GaussianDepth;
use ndarray::Array2;

/// Rule that turns the views' estimates of one pixel into one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Aggregation {
    /// Eq. 7-8: weighted by precision.
    #[default]
    Precision,
    /// The nearest surface, with its view's variance (the smaller one of equally near views).
    MinDepth,
    /// The nearest surface, with the variance \\(1/\tau_r\\) of Eq. 8 over all views. It differs from
    /// [`Precision`](Self::Precision) in the mean alone, and from [`MinDepth`](Self::MinDepth) in the variance alone.
    MinDepthPrecision,
    /// The view of least variance (the nearer one of equally certain views).
    MinVariance,
    /// The plain mean \\(\tfrac1K\sum_j\mu_j\\), variance \\(\tfrac1{K^2}\sum_j\sigma_j^2\\).
    Mean,
    /// The middle view and its variance; of an even number, the two middle views' [`Mean`](Self::Mean).
    Median,
}

/// Aggregates the depth of many views per pixel: Eq. 7-8, or another [`Aggregation`].
///
/// All maps are `[height, width]`, reprojected into one camera. A view that is missing at a pixel does not count
/// there, and a pixel that every view misses stays missing (\\(\tau_r = 0\\)). The order of the views does not
/// matter. With `spread` the variance is that of the mixture of the views instead of that of independent estimates, with
/// \\(\tau_j = 1/(\sigma_r^2)^{(j)}\\)
///
/// \\[ \sigma^2_{\mathrm{mix}} = \sum_j \frac{\tau_j}{\tau_r} \Bigl((\sigma_r^2)^{(j)} +
/// \bigl(\mu_r^{(j)} - \mu_r^{\mathrm{agg}}\bigr)^2\Bigr) \\]
///
/// for [`Aggregation::Precision`], and the same with equal weights for the mean and the median. It does not change the rules
/// that take the depth of one view.
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
/// let both = aggregate(&[near, far], Aggregation::Precision, false)?;
/// let (mean, variance) = both.get(0, 0).ok_or("known by both")?;
/// assert!((mean - 2.25).abs() < 1e-6 && (variance - 0.075).abs() < 1e-7);
/// assert!(both.is_missing(0, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn aggregate(views: &[GaussianDepth], rule: Aggregation, spread: bool) -> Result<GaussianDepth> {
    let (height, width) = views.first().map_or((0, 0), GaussianDepth::dim);
    check_shapes(views, (height, width))?;
    let mut pixels: Vec<_> = views.iter().map(|view| view.mean().into_iter().zip(view.variance())).collect();
    let mut estimates = Vec::with_capacity(views.len());
    let mut mean = Array2::zeros((height, width));
    let mut variance = Array2::from_elem((height, width), f32::INFINITY);
    for (mean, variance) in mean.iter_mut().zip(&mut variance) {
        let known = pixels.iter_mut().filter_map(Iterator::next).filter(|(_, v)| v.is_finite());
        estimates.clear();
        estimates.extend(known.map(|(&m, &v)| Gaussian::new(f64::from(m), f64::from(v))));
        if let Some(g) = combine(&mut estimates, rule, spread) {
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

fn combine(estimates: &mut [Gaussian], rule: Aggregation, spread: bool) -> Option<Gaussian> {
    let by_depth =
        |a: &Gaussian, b: &Gaussian| a.mean.total_cmp(&b.mean).then(a.variance.total_cmp(&b.variance));
    let by_variance =
        |a: &Gaussian, b: &Gaussian| a.variance.total_cmp(&b.variance).then(a.mean.total_cmp(&b.mean));
    let mut result = match rule {
        Aggregation::Precision => precision_weighted(estimates),
        Aggregation::MinDepth => estimates.iter().copied().min_by(by_depth),
        Aggregation::MinDepthPrecision => {
            let nearest = estimates.iter().copied().min_by(by_depth);
            nearest.zip(precision_weighted(estimates)).map(|(g, all)| Gaussian::new(g.mean, all.variance))
        }
        Aggregation::MinVariance => estimates.iter().copied().min_by(by_variance),
        Aggregation::Mean => plain_mean(estimates),
        Aggregation::Median => {
            estimates.sort_unstable_by(by_depth);
            let middle = estimates.len().saturating_sub(1) / 2..estimates.len() / 2 + 1;
            estimates.get(middle).and_then(plain_mean)
        }
    }?;
    if spread {
        match rule {
            Aggregation::Precision => result.variance = mixture_variance(estimates, result.mean),
            Aggregation::Mean | Aggregation::Median => {
                let second = estimates.iter().map(|g| g.variance + (g.mean - result.mean).powi(2));
                result.variance = second.sum::<f64>() / estimates.len() as f64;
            }
            Aggregation::MinDepth | Aggregation::MinDepthPrecision | Aggregation::MinVariance => {}
        }
    }
    Some(result)
}

fn plain_mean(estimates: &[Gaussian]) -> Option<Gaussian> {
    let first = estimates.first()?;
    let count = estimates.len() as f64;
    let offset: f64 = estimates.iter().map(|g| g.mean - first.mean).sum();
    let variance: f64 = estimates.iter().map(|g| g.variance).sum();
    Some(Gaussian::new(first.mean + offset / count, variance / (count * count)))
}
