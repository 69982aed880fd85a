use crate::gaussian::to_f32;
use crate::working::WorkingPrior;
use crate::{
    FusionConfig, Heteroscedastic, PriorVariance, Residual, empirical_bayes, maximum_likelihood,
    paule_mandel, squared_gradient,
};
use mde_uncertainty::statistics::median;
use ndarray::Array2;

/// The prior's variance \\(\sigma_o^2\\), in the working space.
#[derive(Debug)]
pub(crate) enum Spread {
    Constant(f64),
    Map(Array2<f64>),
}

impl Spread {
    /// The prior's own variance if it has one, else what `config` says of the residuals over \\(\mathcal X\\).
    /// `inside` is true on \\(\mathcal X\\); `None` for the residuals where no calibration exists.
    pub(crate) fn find(
        prior: &WorkingPrior,
        residuals: Option<&[Residual]>,
        inside: &[bool],
        config: &FusionConfig,
    ) -> Self {
        if let Some(variance) = &prior.variance {
            return Self::Map(variance.clone());
        }
        let relative = || (config.kappa * prior.median().unwrap_or(0.0)).powi(2);
        let Some(residuals) = residuals.filter(|r| !r.is_empty()) else {
            return Self::Constant(relative());
        };
        Self::Constant(match config.prior_variance {
            PriorVariance::Moments => empirical_bayes(residuals),
            PriorVariance::FixedMedian => median(residuals.iter().map(|r| to_f32(r.variance))).unwrap_or(0.0),
            PriorVariance::FixedRelative => relative(),
            PriorVariance::PauleMandel => paule_mandel(residuals),
            PriorVariance::MaximumLikelihood => maximum_likelihood(residuals),
            PriorVariance::Heteroscedastic => return Self::heteroscedastic(prior, residuals, inside),
        })
    }

    fn heteroscedastic(prior: &WorkingPrior, residuals: &[Residual], inside: &[bool]) -> Self {
        let gradient2 = squared_gradient(prior.mean.view());
        let known = prior.mean.iter().zip(&gradient2).zip(inside).filter(|(_, inside)| **inside);
        let pixels = residuals.iter().zip(known).map(|(r, ((&mean, &g2), _))| (r, mean, g2));
        let model = Heteroscedastic::fit(pixels);
        let mut map = gradient2;
        map.zip_mut_with(&prior.mean, |g2, &mean| *g2 = model.variance(mean, *g2));
        Self::Map(map)
    }

    /// One value a pixel, in the order of the map's rows.
    pub(crate) fn values(&self) -> impl Iterator<Item = f64> {
        let (constant, map) = match self {
            Self::Constant(value) => (Some(*value), None),
            Self::Map(map) => (None, Some(map.iter().copied())),
        };
        constant.into_iter().cycle().chain(map.into_iter().flatten())
    }

    /// Square root of the mean over \\(\mathcal X\\), or over all known values where it is empty.
    pub(crate) fn rms(&self, inside: &[bool]) -> f64 {
        let all = !inside.contains(&true);
        let chosen = self.values().zip(inside).filter(|(v, inside)| v.is_finite() && (all || **inside));
        let (sum, count) = chosen.fold((0.0, 0.0), |(sum, count), (v, _)| (sum + v, count + 1.0));
        if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
    }
}
