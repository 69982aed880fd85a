use crate::Gaussian;

/// The views' weight \\(w = s / (s + c)\\) against a prior of variance \\(s\\), where the calibrated views have
/// variance \\(c = a^2 (\sigma_r^2)^{\mathrm{agg}}\\); 0 where both are 0.
#[inline]
pub(crate) fn nerf_weight(prior_variance: f64, nerf_variance: f64) -> f64 {
    if prior_variance > 0.0 { prior_variance / (prior_variance + nerf_variance) } else { 0.0 }
}

/// Posterior of a Gaussian prior and a Gaussian likelihood (Eq. 16-17).
///
/// \\[ D_{\mathrm{refined}} =
/// \frac{\frac{1}{\sigma_o^2} D_o + \frac{1}{c} \tilde D_r}{\frac{1}{\sigma_o^2} + \frac{1}{c}},
/// \qquad \sigma_{\mathrm{refined}}^2 = \left(\frac{1}{\sigma_o^2} + \frac{1}{c}\right)^{-1},
/// \qquad c = a^2 (\sigma_r^2)^{\mathrm{agg}} \\]
///
/// in the form that divides by no variance, with \\(s = \sigma_o^2\\):
///
/// \\[ w = \frac{s}{s + c},\qquad D_{\mathrm{refined}} = D_o + w (\tilde D_r - D_o),\qquad
/// \sigma_{\mathrm{refined}}^2 = \frac{s c}{s + c} = w c. \\]
///
/// Where both are exact (\\(s = c = 0\\)), or \\(c\\) is infinite, the result is the prior; where \\(s\\) is infinite, the likelihood.
#[inline]
pub fn posterior(prior: Gaussian, likelihood: Gaussian) -> Gaussian {
    // A side of precision 0 has no weight.
    if likelihood.variance == f64::INFINITY {
        return prior;
    }
    if prior.variance == f64::INFINITY {
        return likelihood;
    }
    let w = nerf_weight(prior.variance, likelihood.variance);
    let step = likelihood.mean - prior.mean;
    // From the nearer side, so that an exact likelihood is returned exactly too.
    let mean = if w > 0.5 {
        likelihood.mean - step * (likelihood.variance / (prior.variance + likelihood.variance))
    } else {
        prior.mean + w * step
    };
    // The last bit of rounding must not carry the mean past either.
    let mean = mean.max(prior.mean.min(likelihood.mean)).min(prior.mean.max(likelihood.mean));
    Gaussian::new(mean, w * likelihood.variance)
}
