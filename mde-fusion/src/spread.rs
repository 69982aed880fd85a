use crate::bayes::prior_median;
use crate::gaussian::to_f32;
use crate::heteroscedastic::{Heteroscedastic, squared_gradient};
use crate::{FusionConfig, Prior, PriorVariance, Residual, empirical_bayes};
use mde_uncertainty::statistics::median;
use ndarray::Array2;

/// The prior's variance \\(\sigma_o^2\\).
#[derive(Debug)]
pub(crate) enum Spread {
    Constant(f64),
    Map(Array2<f64>),
}

impl Spread {
    /// The prior's own variance if it has one, else the estimate from the residuals over \\(\mathcal X\\) by `config`.
    /// `inside` is true on \\(\mathcal X\\); the residuals are `None` where no calibration exists.
    pub(crate) fn find(
        prior: &Prior,
        residuals: Option<&[Residual]>,
        inside: &[bool],
        config: &FusionConfig,
    ) -> Self {
        if let Some(variance) = prior.variance() {
            return Self::Map(variance.mapv(f64::from));
        }
        let relative = || (config.kappa * prior_median(prior)).powi(2);
        let Some(residuals) = residuals.filter(|r| !r.is_empty()) else {
            return Self::Constant(relative());
        };
        Self::Constant(match config.prior_variance {
            PriorVariance::Moments => empirical_bayes(residuals),
            PriorVariance::FixedMedian => median(residuals.iter().map(|r| to_f32(r.variance))).unwrap_or(0.0),
            PriorVariance::FixedRelative => relative(),
            PriorVariance::Heteroscedastic => return Self::heteroscedastic(prior, residuals, inside),
        })
    }

    fn heteroscedastic(prior: &Prior, residuals: &[Residual], inside: &[bool]) -> Self {
        let depth = prior.mean().mapv(f64::from);
        let gradient2 = squared_gradient(depth.view());
        let known = depth.iter().zip(&gradient2).zip(inside).filter(|(_, inside)| **inside);
        let pixels = residuals.iter().zip(known).map(|(r, ((&depth, &g2), _))| (r, depth, g2));
        let model = Heteroscedastic::fit(pixels);
        let mut map = gradient2;
        map.zip_mut_with(&depth, |g2, &depth| *g2 = model.variance(depth, *g2));
        Self::Map(map)
    }

    /// One value per pixel, row by row.
    pub(crate) fn values(&self) -> impl Iterator<Item = f64> {
        let (constant, map) = match self {
            Self::Constant(value) => (Some(*value), None),
            Self::Map(map) => (None, Some(map.iter().copied())),
        };
        constant.into_iter().cycle().chain(map.into_iter().flatten())
    }

    /// Square root of the mean over \\(\mathcal X\\), or over all finite values where it is empty.
    pub(crate) fn rms(&self, inside: &[bool]) -> f64 {
        let all = !inside.contains(&true);
        let chosen = self.values().zip(inside).filter(|(v, inside)| v.is_finite() && (all || **inside));
        let (sum, count) = chosen.fold((0.0, 0.0), |(sum, count), (v, _)| (sum + v, count + 1.0));
        if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
    }
}
