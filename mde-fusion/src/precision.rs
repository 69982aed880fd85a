use crate::Gaussian;
use crate::gaussian::relative_precision;

/// Precision-weighted mean of independent estimates (Eq. 7-8).
///
/// \\[ \tau_r = \sum_{j\in\mathcal V} \frac{1}{(\sigma_r^2)^{(j)}},\qquad
/// \mu_r^{\mathrm{agg}} = \frac{1}{\tau_r} \sum_{j\in\mathcal V} \frac{\mu_r^{(j)}}{(\sigma_r^2)^{(j)}},\qquad
/// (\sigma_r^2)^{\mathrm{agg}} = \frac{1}{\tau_r} \\]
///
/// `None` where there is no estimate, that is \\(\tau_r = 0\\). The weights are taken relative to the largest, so
/// that no precision overflows. Estimates of variance 0 are exact: their plain mean is the limit, with variance 0.
pub fn precision_weighted(estimates: &[Gaussian]) -> Option<Gaussian> {
    let first = estimates.first()?;
    let least = Some(least_variance(estimates)).filter(|least| least.is_finite())?;
    let (mut tau, mut offset) = (0.0, 0.0);
    // About the first estimate: equal estimates then give exactly themselves.
    for g in estimates {
        let weight = relative_precision(least, g.variance);
        tau += weight;
        offset += weight * (g.mean - first.mean);
    }
    Some(Gaussian::new(first.mean + offset / tau, least / tau))
}

/// Variance of the mixture of the views with the weights of Eq. 7, which does not assume that their errors are
/// independent.
///
/// \\[ \sigma^2_{\mathrm{mix}} = \frac{|\mathcal V|}{\tau_r} + \sum_j \frac{\tau_j}{\tau_r}
/// \bigl(\mu_r^{(j)} - \mu_r^{\mathrm{agg}}\bigr)^2,\qquad \tau_j = 1/(\sigma_r^2)^{(j)} \\]
///
/// The first term is \\(\sum_j \tfrac{\tau_j}{\tau_r} (\sigma_r^2)^{(j)}\\), so this is the law of total variance.
/// Eq. 8 divides the variance by the number of views. Renders of one field share their error, so that Eq. 8 is too small by up
/// to that number.
///
/// `mean` is \\(\mu_r^{\mathrm{agg}}\\). 0 without estimates.
pub(crate) fn mixture_variance(estimates: &[Gaussian], mean: f64) -> f64 {
    let least = least_variance(estimates);
    let (mut tau, mut second) = (0.0, 0.0);
    for g in estimates {
        let weight = relative_precision(least, g.variance);
        tau += weight;
        // weight * variance is `least` for every estimate of variance > 0, and 0 where one is exact.
        second += least + weight * (g.mean - mean).powi(2);
    }
    if tau > 0.0 { second / tau } else { 0.0 }
}

fn least_variance(estimates: &[Gaussian]) -> f64 {
    estimates.iter().map(|g| g.variance).fold(f64::INFINITY, f64::min)
}
